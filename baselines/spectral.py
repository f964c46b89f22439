"""Filters on the manifold harmonics of a mesh: low pass, enhancement, exaggeration, any weights."""

import math
from typing import Annotated, Literal

import numpy as np

from cascadenorm.geometry.spectra.fast_harmonics import fast_harmonics
from cascadenorm.geometry.spectra.harmonics import Harmonics, checked_count, manifold_harmonics
from cascadenorm.mesh import Floats, Mesh, Vectors
from cascadenorm.registry import Parameter, ParameterError, method

EXACT_LIMIT = 200_000  # vertices above which "auto" approximates the harmonics
HARMONICS_COUNT = 300


@method("spectral", source="Vallet, Lévy 2008; Nasikun, Brandt, Hildebrandt 2018", family="smoothing")
def spectral(
    mesh: Mesh,
    *,
    harmonics: Annotated[
        int | None, Parameter("Number of eigenpairs. Default: 300, or all of a smaller mesh", minimum=1)
    ] = None,
    transfer: Annotated[
        Literal["low-pass", "enhance", "exaggerate"],
        Parameter(
            "low-pass drops harmonics above the band; enhance multiplies all from its start, exaggerate only the "
            "band, by the gain"
        ),
    ] = "low-pass",
    band_start: Annotated[
        int | None,
        Parameter(
            "First harmonic of the band, counted from 0. Default: after the constant ones, one for each component",
            minimum=0,
        ),
    ] = None,
    band_end: Annotated[int | None, Parameter("First harmonic after the band. Default: none", minimum=1)] = None,
    gain: Annotated[float, Parameter("Factor of the amplitudes", minimum=0, below=math.inf)] = 1.5,
    eigenpairs: Annotated[
        Literal["auto", "exact", "approximate"],
        Parameter("auto approximates the eigenpairs of more than 200,000 vertices"),
    ] = "auto",
) -> Vectors:
    """Filter the vertices by their harmonics: keep the lowest ones, or strengthen a band of them.

    Formula
    -------
    x ← Σ_i w_i <x, φ_i> φ_i + w_∞ (x - Σ_i <x, φ_i> φ_i),   S φ_i = λ_i M φ_i

    Limits
    ------
    Edges are rounded and cause ringing, because they consist of all frequencies. A low-pass removes all detail beyond
    the last harmonic, not only noise.
    """
    available = int((mesh.topology.vertex_faces.counts > 0).sum())
    count = min(HARMONICS_COUNT, available) if harmonics is None else harmonics
    checked_count(count, available)
    parts = len(np.unique(mesh.topology.face_components))
    if parts >= count and count < available:
        raise ParameterError(
            f"the mesh has {parts} connected components, each of which needs a constant harmonic of its own; harmonics "
            f"is {count}: request more, or remove small components"
        )
    start, end = parts if band_start is None else band_start, count if band_end is None else band_end
    if end > count or (start >= end and transfer != "low-pass"):
        raise ParameterError(f"the band from {start} to {end} must be within the {count} harmonics, and not empty")
    approximate = eigenpairs == "approximate" or (eigenpairs == "auto" and available > EXACT_LIMIT)
    basis = fast_harmonics(mesh, count) if approximate else manifold_harmonics(mesh, count)
    weights = np.ones(count)
    if transfer == "low-pass":
        weights[end:] = 0
        rest = 0.0
    else:
        weights[start : end if transfer == "exaggerate" else count] = gain
        rest = gain if transfer == "enhance" else 1.0
    return filtered(mesh, basis, weights, rest=rest)


def filtered(mesh: Mesh, harmonics: Harmonics, weights: Floats, *, rest: float = 1.0) -> Vectors:
    """Return x' = Σ w_i <x, φ_i> φ_i + rest (x - Σ <x, φ_i> φ_i), (n, 3); vertices without a face stay.

    The weights, (k,), scale the harmonics: 1 keeps a harmonic, 0 removes it, and more than 1 amplifies it. `rest` is
    the weight of everything beyond the k harmonics.
    """
    coefficients = harmonics.coefficients(mesh.vertices)
    vertices = rest * mesh.vertices + harmonics.combined((weights[:, None] - rest) * coefficients)
    return np.where(harmonics.mass[:, None] > 0, vertices, mesh.vertices)
