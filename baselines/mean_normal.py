"""Weighted means of the normals around a face: plain, of similar ones (unilateral), of those a random walk visits.

Neighbours are the faces that share a vertex, and the face itself.
"""

from functools import partial
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from cascadenorm.baselines.bilateral_normal import Passes, RangeSpread, bilateral_normals
from cascadenorm.baselines.vertex_fit import VertexFit, filter_rings, fit_rings, fit_vertices
from cascadenorm.baselines.vertex_update import Sweeps
from cascadenorm.execution.progress import track
from cascadenorm.mesh import Csr, Mesh, Vectors, kernel, parallel_for, unit
from cascadenorm.mesh.vectors import dot, length, row, squared_distance
from cascadenorm.patches.work import normals_by_patches
from cascadenorm.registry import Parameter, method

Threshold = Annotated[
    float, Parameter("Cosine of the angle between normals below which a neighbour has no weight", minimum=-1, below=1)
]
WalkLength = Annotated[int, Parameter("Number of steps of the random walk", minimum=0)]


@method("mean-normal", source="Yagou, Ohtake, Belyaev 2002", family="normals", rings=filter_rings)
def mean_normal(mesh: Mesh, *, iterations: Passes = 3, sweeps: Sweeps = 10, fit: VertexFit = "sweeps") -> Vectors:
    """Replace each face normal by the area-weighted mean of the normals around it, then fit the vertices.

    Formula
    -------
    n_f ← unit Σ_g A_g n_g,   g shares a vertex with f, or is f

    Limits
    ------
    Every edge is rounded, and more passes round it more.
    """
    filtered = partial(bilateral_normals, sigma_s=np.inf, sigma_r=np.inf, iterations=iterations, center="count")
    normals = normals_by_patches(mesh, filtered, receptive_field=iterations)
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps)


@method("unilateral-normal", source="Sun, Rosin, Martin, Langbein 2007", family="normals", rings=filter_rings)
def unilateral_normal(
    mesh: Mesh, *, threshold: Threshold = 0.4, iterations: Passes = 10, sweeps: Sweeps = 10, fit: VertexFit = "sweeps"
) -> Vectors:
    """Average each face normal with similar ones around it: n_f ← unit Σ_g max(<n_f, n_g> - T, 0)² n_g.

    Formula
    -------
    n_f ← unit Σ_g max(<n_f, n_g> - T, 0)² n_g,   g shares a vertex with f, or is f

    Limits
    ------
    Edges whose angle has a cosine above T are rounded. Faces are not weighed by area, so uneven meshes are pulled
    toward where faces are small.
    """
    filtered = partial(unilateral_normals, threshold=threshold, iterations=iterations)
    normals = normals_by_patches(mesh, filtered, receptive_field=iterations)
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps)


@method(
    "random-walk-normal",
    source="Sun, Rosin, Martin, Langbein 2008",
    family="normals",
    rings=lambda given, groups: fit_rings(given, groups, given["length"] * given["iterations"]),
)
def random_walk_normal(
    mesh: Mesh,
    *,
    sigma_r: RangeSpread = 0.45,
    length: WalkLength = 2,
    iterations: Passes = 5,
    sweeps: Sweeps = 10,
    fit: VertexFit = "sweeps",
) -> Vectors:
    """Average each face normal with those that a random walk from it visits, which prefers similar normals.

    Formula
    -------
    n_f ← unit Σ_g P^k_fg n_g,   P_fg ∝ exp(-|n_g - n_f|²/2σ_r²) for g that share a vertex with f, and for f itself

    Limits
    ------
    One σ_r serves the whole mesh, as in bilateral-normal. Faces are not weighted by area or distance.
    """
    filtered = partial(walk_normals, sigma_r=sigma_r, length=length, iterations=iterations)
    normals = normals_by_patches(mesh, filtered, receptive_field=length * iterations)
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps)


def unilateral_normals(mesh: Mesh, *, threshold: float, iterations: int) -> Vectors:
    """Return (m, 3) the face normals after some passes of the unilateral filter."""
    rings = mesh.topology.face_rings(1)
    normals = mesh.face_normals
    for _ in track(iterations):
        normals = unilateral_pass(normals, rings, threshold)
    return normals


def walk_normals(mesh: Mesh, *, sigma_r: float, length: int, iterations: int) -> Vectors:
    """Return (m, 3) the face normals after some passes, each of which takes the mean over where walks end."""
    rings = mesh.topology.face_rings(1)
    normals = mesh.face_normals
    for _ in track(iterations):
        normals = unit(walk_means(normals, rings, sigma_r=sigma_r, length=length), otherwise=normals)
    return normals


def unilateral_pass(normals: Vectors, rings: Csr, threshold: float) -> Vectors:
    """One pass of the unilateral filter; the face itself takes part, so that the weights never vanish."""
    out = np.empty_like(normals)
    parallel_for(len(normals), _unilateral_pass, normals, rings, threshold, out)
    return out


def walk_means(normals: Vectors, rings: Csr, *, sigma_r: float, length: int) -> Vectors:
    """Return (m, 3) the expected normal where a walk of `length` steps from each face ends.

    A step leads from f to g, or stays at f, with a probability proportional to exp(-|n_f - n_g|²/2σ_r²).
    """
    means: NDArray[np.float64] = normals
    for _ in range(length):
        following = np.empty_like(normals)
        parallel_for(len(normals), _walk_step, means, normals, rings, 0.5 / sigma_r**2, following)
        means = following
    return means


@kernel
def _unilateral_pass(start: int, stop: int, normals: Vectors, rings: Csr, threshold: float, out: Vectors) -> None:
    for f in range(start, stop):
        own = (1.0 - threshold) ** 2
        x, y, z = own * normals[f, 0], own * normals[f, 1], own * normals[f, 2]
        for k in range(rings.indptr[f], rings.indptr[f + 1]):
            g = rings.indices[k]
            w = max(dot(row(normals, f), row(normals, g)) - threshold, 0.0) ** 2
            x += w * normals[g, 0]
            y += w * normals[g, 1]
            z += w * normals[g, 2]
        size = length((x, y, z))
        scale = 1.0 / size if size > 0.0 else 0.0
        out[f, 0], out[f, 1], out[f, 2] = scale * x, scale * y, scale * z


@kernel
def _walk_step(
    start: int, stop: int, values: Vectors, normals: Vectors, rings: Csr, spread: float, out: Vectors
) -> None:
    for f in range(start, stop):
        x, y, z, total = values[f, 0], values[f, 1], values[f, 2], 1.0
        for k in range(rings.indptr[f], rings.indptr[f + 1]):
            g = rings.indices[k]
            w = np.exp(-spread * squared_distance(row(normals, g), row(normals, f)))
            x += w * values[g, 0]
            y += w * values[g, 1]
            z += w * values[g, 2]
            total += w
        out[f, 0], out[f, 1], out[f, 2] = x / total, y / total, z / total
