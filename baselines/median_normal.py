"""Weighted median filtering of face normals (Yagou, Ohtake, Belyaev 2002)."""

from functools import partial
from typing import Annotated, Literal

import numpy as np

from cascadenorm.baselines.bilateral_normal import Passes
from cascadenorm.baselines.vertex_fit import VertexFit, filter_rings, fit_vertices
from cascadenorm.baselines.vertex_update import Sweeps
from cascadenorm.execution.progress import track
from cascadenorm.mesh import Csr, Floats, Mesh, Vectors, kernel, parallel_for
from cascadenorm.mesh.vectors import length, row, squared_distance, subtract
from cascadenorm.patches.work import normals_by_patches
from cascadenorm.registry import Parameter, method

Median = Annotated[
    Literal["vector", "angle"],
    Parameter("Median of the normals (least weighted distance to all others), or of their angles to the face normal"),
]


@method("median-normal", source="Yagou, Ohtake, Belyaev 2002", family="normals", rings=filter_rings)
def median_normal(
    mesh: Mesh, *, median: Median = "vector", iterations: Passes = 5, sweeps: Sweeps = 10, fit: VertexFit = "sweeps"
) -> Vectors:
    """Replace each face normal by the weighted median of those around it, then fit the vertices.

    Formula
    -------
    vector: n_f ← argmin over n_g of Σ_h A_h |n_g - n_h|;   g, h share a vertex with f, or are f
    angle:  n_f ← the n_g at half of the weight A when sorted by |n_g - n_f|

    Limits
    ------
    The result is one of the noisy normals, so smooth surfaces keep a grain. It suits impulsive noise best.
    """
    filtered = partial(median_normals, median=median, iterations=iterations)
    normals = normals_by_patches(mesh, filtered, receptive_field=iterations)
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps)


def median_normals(mesh: Mesh, *, median: Literal["vector", "angle"], iterations: int) -> Vectors:
    """Return (m, 3) the face normals after some passes of the median filter."""
    normals = mesh.face_normals
    for _ in track(iterations):
        normals = median_pass(mesh, normals, median=median)
    return normals


def median_pass(mesh: Mesh, normals: Vectors, *, median: Literal["vector", "angle"]) -> Vectors:
    """Return (m, 3) one of the normals around each face, its own among them; weights are the areas.

    "vector" takes the one with the least weighted sum of chords to the others; "angle" sorts them by their angle to
    the face's own normal and takes the one at half the weight. Of equal ones the face's own wins.
    """
    rings = mesh.topology.face_rings(1)
    out = np.empty_like(normals)
    run = _vector_medians if median == "vector" else _angle_medians
    parallel_for(len(normals), run, normals, mesh.areas, rings, out)
    return out


@kernel
def _vector_medians(start: int, stop: int, normals: Vectors, areas: Floats, rings: Csr, out: Vectors) -> None:
    for f in range(start, stop):
        around = np.empty(rings.indptr[f + 1] - rings.indptr[f] + 1, np.int32)
        around[0] = f
        around[1:] = rings.indices[rings.indptr[f] : rings.indptr[f + 1]]
        totals = np.zeros(len(around))
        for i in range(len(around)):
            g = around[i]
            for j in range(i):
                h = around[j]
                chord = length(subtract(row(normals, g), row(normals, h)))
                totals[i] += areas[h] * chord
                totals[j] += areas[g] * chord
        best = 0
        for i in range(len(around)):
            if areas[around[i]] > 0.0 and totals[i] < totals[best]:
                best = i
        out[f] = normals[around[best]]


@kernel
def _angle_medians(start: int, stop: int, normals: Vectors, areas: Floats, rings: Csr, out: Vectors) -> None:
    for f in range(start, stop):
        if areas[f] == 0.0:  # all are as far from it
            out[f, 0], out[f, 1], out[f, 2] = row(normals, f)
            continue
        count = rings.indptr[f + 1] - rings.indptr[f]
        chords = np.empty(count)
        half = 0.5 * areas[f]
        for k in range(count):
            g = rings.indices[rings.indptr[f] + k]
            chords[k] = squared_distance(row(normals, g), row(normals, f))  # grows with the angle
            half += 0.5 * areas[g]
        best, passed = f, areas[f]
        for k in np.argsort(chords, kind="mergesort"):
            if passed >= half:
                break
            best = rings.indices[rings.indptr[f] + k]
            passed += areas[best]
        out[f, 0], out[f, 1], out[f, 2] = row(normals, best)
