"""Means and medians of the normals around a face: plain means, means of similar normals or over random walks, medians.

Neighbours are the faces that share a vertex, and the face itself.
"""

from functools import partial
from typing import Annotated, Literal

import numpy as np

from cascadenorm.baselines.bilateral_normal import Passes, RangeSpread, bilateral_normals, steepness
from cascadenorm.baselines.vertex_update import Sweeps, VertexFit, filter_rings, fit_rings, fit_vertices
from cascadenorm.execution.progress import track
from cascadenorm.geometry.patches.work import normals_by_patches
from cascadenorm.mesh import Csr, Floats, Mesh, Vectors, kernel, parallel_for, unit
from cascadenorm.mesh.vectors import add, divided, dot, length, row, scaled, squared_distance, subtract
from cascadenorm.registry import Parameter, method

Threshold = Annotated[
    float, Parameter("Cosine of the angle between normals below which a neighbour has no weight", minimum=-1, below=1)
]
WalkLength = Annotated[int, Parameter("Number of steps of the random walk", minimum=0)]
Median = Annotated[
    Literal["vector", "angle"],
    Parameter("Median of the normals (least weighted distance to all others), or of their angles to the face normal"),
]


@method("mean-normal", source="Yagou, Ohtake, Belyaev 2002", family="normals", rings=filter_rings)
def mean_normal(mesh: Mesh, *, iterations: Passes = 3, sweeps: Sweeps = 10, fit: VertexFit = "sweeps") -> Vectors:
    """Replace each face normal by the area-weighted mean of the normals around it, then fit the vertices.

    Formula
    -------
    n_f ← unit Σ_g A_g n_g,   g shares a vertex with f, or is f

    Limits
    ------
    All edges are rounded, more so with more passes.
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
    Edges whose angle has a cosine above T are rounded. Faces are not weighted by area, so that regions of small faces
    have more influence on uneven meshes.
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
    """Average each face normal with those at the ends of random walks that prefer similar normals.

    Formula
    -------
    n_f ← unit Σ_g P^k_fg n_g,   P_fg ∝ exp(-|n_g - n_f|²/2σ_r²) for g that share a vertex with f, and for f itself

    Limits
    ------
    One σ_r applies to the whole mesh, as in bilateral-normal. Faces are not weighted by area or distance.
    """
    filtered = partial(walk_normals, sigma_r=sigma_r, length=length, iterations=iterations)
    normals = normals_by_patches(mesh, filtered, receptive_field=length * iterations)
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps)


def unilateral_normals(mesh: Mesh, *, threshold: float, iterations: int) -> Vectors:
    """Return the (m, 3) face normals after some passes of the unilateral filter."""
    rings, normals = mesh.topology.face_rings(1), mesh.face_normals
    for _ in track(iterations):
        out = np.empty_like(normals)
        parallel_for(len(normals), _unilateral_pass, normals, rings, threshold, out)
        normals = out
    return normals


def walk_normals(mesh: Mesh, *, sigma_r: float, length: int, iterations: int) -> Vectors:
    """Return the (m, 3) face normals after some passes, each of which takes the mean normal at the ends of walks."""
    rings, normals = mesh.topology.face_rings(1), mesh.face_normals
    for _ in track(iterations):
        normals = unit(walk_means(normals, rings, sigma_r=sigma_r, length=length), otherwise=normals)
    return normals


def walk_means(normals: Vectors, rings: Csr, *, sigma_r: float, length: int) -> Vectors:
    """Return the (m, 3) expected normals at the end of a random walk of `length` steps from each face.

    A step leads from f to g, or stays at f, with a probability proportional to exp(-|n_f - n_g|²/2σ_r²).
    """
    means: Floats = normals
    for _ in range(length):
        following = np.empty_like(normals)
        parallel_for(len(normals), _walk_step, means, normals, rings, steepness(sigma_r), following)
        means = following
    return means


@kernel
def _unilateral_pass(start: int, stop: int, normals: Vectors, rings: Csr, threshold: float, out: Vectors) -> None:
    """Apply one pass of the unilateral filter; the face itself is included, so that the weights never vanish."""
    for f in range(start, stop):
        total = scaled((1.0 - threshold) ** 2, row(normals, f))
        for k in range(rings.indptr[f], rings.indptr[f + 1]):
            near = row(normals, rings.indices[k])
            total = add(total, scaled(max(dot(row(normals, f), near) - threshold, 0.0) ** 2, near))
        size = length(total)
        out[f, 0], out[f, 1], out[f, 2] = scaled(1.0 / size if size > 0.0 else 0.0, total)


@kernel
def _walk_step(
    start: int, stop: int, values: Vectors, normals: Vectors, rings: Csr, spread: float, out: Vectors
) -> None:
    for f in range(start, stop):
        mean, total = row(values, f), 1.0
        for k in range(rings.indptr[f], rings.indptr[f + 1]):
            g = rings.indices[k]
            w = np.exp(-spread * squared_distance(row(normals, g), row(normals, f)))
            mean, total = add(mean, scaled(w, row(values, g))), total + w
        out[f, 0], out[f, 1], out[f, 2] = divided(mean, total)


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
    The result is one of the noisy normals, so smooth surfaces stay grainy. It suits impulsive noise best.
    """
    filtered = partial(median_normals, median=median, iterations=iterations)
    normals = normals_by_patches(mesh, filtered, receptive_field=iterations)
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps)


def median_normals(mesh: Mesh, *, median: Literal["vector", "angle"], iterations: int) -> Vectors:
    """Return the (m, 3) face normals after some passes of the median filter."""
    normals = mesh.face_normals
    for _ in track(iterations):
        normals = median_pass(mesh, normals, median=median)
    return normals


def median_pass(mesh: Mesh, normals: Vectors, *, median: Literal["vector", "angle"]) -> Vectors:
    """Return the (m, 3) weighted medians of the normals around each face and its own; the weights are the areas.

    "vector" selects the normal with the least weighted sum of chords to the others. "angle" sorts them by their angle
    to the face's own normal and selects the one at half of the weight. In a tie, the face keeps its own normal.
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
        if areas[f] == 0.0:  # all normals have the same distance from zero
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
