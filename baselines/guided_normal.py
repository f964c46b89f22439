"""Guided filtering of face normals (Zhang, Deng, Zhang, Bouaziz, Liu 2015).

This is a joint bilateral filter. Its range weight compares guidance normals instead of the noisy ones: the mean normal
of the most consistent patch near a face, or the Gaussian mean. The vertices are updated after each pass, so that the
next one filters the normals that the mesh has by then.
"""

from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np

from cascadenorm.baselines.bilateral_normal import joint_bilateral_pass, spatial_weights
from cascadenorm.baselines.vertex_update import Sweeps, VertexFit, fit_vertices
from cascadenorm.execution.progress import track
from cascadenorm.geometry.neighborhoods import faces_near
from cascadenorm.geometry.patches.cutting import MeshPatch
from cascadenorm.geometry.patches.work import active_patching, face_rows
from cascadenorm.mesh import (
    SMALLEST_COSTLY_CHUNK,
    Csr,
    Floats,
    Ints32,
    Mesh,
    Vectors,
    kernel,
    parallel_for,
    row_distances,
)
from cascadenorm.mesh.vectors import add, dot, length, row, scaled, squared_distance, subtract
from cascadenorm.registry import Parameter, method

Guidance = Annotated[
    Literal["patch", "gaussian"], Parameter("Guidance normals: mean of the most consistent patch, or Gaussian mean")
]
GuideSpread = Annotated[
    float | None,
    Parameter(
        "Spread over the chord between guidance normals. Default: 0.45, or 0.15 for the mean", "chord", minimum=1e-6
    ),
]
GuidedPasses = Annotated[int | None, Parameter("Number of passes. Default: 10, or 20 for the mean", minimum=0)]
Radius = Annotated[
    float | None,
    Parameter(
        "Radius around a face centroid. Default: twice the mean distance between centroids of adjacent faces",
        "mean edge lengths",
        above=0,
    ),
]
FIRST_REACH = 10  # edges around a face that a pass is first assumed to depend on; neighbourhoods are by distance
GuidedDistance = Annotated[
    float | None,
    Parameter(
        "Spread over distance. Default: mean distance between centroids of adjacent faces",
        "mean edge lengths",
        minimum=1e-6,
    ),
]


@method("guided-normal", source="Zhang, Deng, Zhang, Bouaziz, Liu 2015", family="normals")
def guided_normal(
    mesh: Mesh,
    *,
    guidance: Guidance = "patch",
    radius: Radius = None,
    sigma_s: GuidedDistance = None,
    sigma_r: GuideSpread = None,
    iterations: GuidedPasses = None,
    sweeps: Sweeps = 10,
    fit: VertexFit = "sweeps",
) -> Vectors:
    """Average each face normal with those of near faces that have a similar guidance, then fit the vertices.

    Formula
    -------
    n_f ← unit Σ_g A_g exp(-|c_g - c_f|²/2σ_s²) exp(-|γ_g - γ_f|²/2σ_r²) n_g
    γ_f = mean normal of the patch near f with the least H = max |n_i - n_j| · max |φ| / (ε + Σ |φ|)

    Limits
    ------
    Patches span about two rings: features narrower than that, and corners where many edges meet, blur or shift. On
    organic shapes, flat patches can turn into facets.
    """
    usual_spread, usual_passes = (0.45, 10) if guidance == "patch" else (0.15, 20)
    sigma_r = usual_spread if sigma_r is None else sigma_r
    start, radius = mesh, 2 * centroid_distance(mesh) if radius is None else radius
    neighbors = None if active_patching(mesh) else faces_within(mesh, radius)
    for _ in track(usual_passes if iterations is None else iterations):
        spread = centroid_distance(mesh) if sigma_s is None else sigma_s
        settings: dict[str, Any] = {"guidance": guidance, "sigma_s": spread, "sigma_r": sigma_r}
        if neighbors is not None:
            normals = guided_normals(mesh, neighbors, **settings)
        else:
            work = partial(_of_patch, settings, radius, start.mean_edge_length)
            normals = face_rows(
                mesh, work, receptive_field=FIRST_REACH, facts=["mean_edge_length"], vertices=[start.vertices]
            )
        mesh = mesh.moved(fit_vertices(mesh, normals, fit=fit, sweeps=sweeps))
    return mesh.vertices.copy()


def guided_normals(
    mesh: Mesh, neighbors: Csr, *, guidance: Literal["patch", "gaussian"], sigma_s: float, sigma_r: float
) -> Vectors:
    """Return the (m, 3) normals after one pass over the neighbours of each face; sigma_s in mean edge lengths."""
    guide = patch_guidance(mesh) if guidance == "patch" else gaussian_guidance(mesh, neighbors, sigma_s)
    weights = spatial_weights(mesh, neighbors, sigma_s)
    return joint_bilateral_pass(mesh.face_normals, guide, mesh.areas, neighbors, weights, sigma_r)


def _of_patch(settings: Mapping[str, Any], radius: float, edge: float, patch: MeshPatch, start: Vectors) -> Vectors:
    """Return the normals of a patch after one pass; neighbours are those of the mesh as it was given.

    `edge` is the mean edge length of that whole mesh, and `start`, (k, 3), are the vertices of the patch in it. Raises
    TooNarrow if a face depends on others beyond the halo.
    """
    neighbors = faces_within(patch.mesh.moved(start).with_facts(mean_edge_length=edge), radius)
    around = neighbors if settings["guidance"] == "gaussian" else patch.mesh.topology.face_rings(1)
    seen = patch.own  # then their neighbours, and the faces whose guidance these have
    for graph in (neighbors, around):
        seen = seen.copy()
        seen[graph.indices[seen[graph.rows]]] = True
    patch.check_complete(seen)
    return guided_normals(patch.mesh, neighbors, **settings)


def centroid_distance(mesh: Mesh) -> float:
    """Return the mean distance between centroids of adjacent faces in mean edge lengths; 0.58 for equilateral ones."""
    distances = row_distances(mesh.centroids, mesh.topology.face_pairs)
    return float(distances.mean() / mesh.mean_edge_length) if distances.any() else 1.0


def faces_within(mesh: Mesh, radius: float) -> Csr:
    """Return the other faces with centroids within `radius` mean edge lengths that are connected through such faces."""
    count = len(mesh.faces)
    near = faces_near(mesh, np.arange(count, dtype=np.int32), radius * mesh.mean_edge_length)
    return Csr(near.indptr - np.arange(count + 1), near.indices[near.indices != near.rows])


def gaussian_guidance(mesh: Mesh, neighbors: Csr, sigma_s: float) -> Vectors:
    """Return the (m, 3) mean normals around the faces, weighted by area and a Gaussian of the distance."""
    weights = spatial_weights(mesh, neighbors, sigma_s)
    return joint_bilateral_pass(mesh.face_normals, mesh.face_normals, mesh.areas, neighbors, weights, np.inf)


def patch_guidance(mesh: Mesh) -> Vectors:
    """Return the (m, 3) mean normals of the most consistent patch near each face.

    The patch of a face is itself and the faces that share a vertex with it; a face chooses among its own patch and
    those of these neighbours. The smaller this value is, the more consistent the patch is:

        H = max |n_i - n_j| over its faces × max |φ| / (ε + Σ |φ|), φ = n_i - n_j over the edges inside it

    The first factor is small for flat patches, and the second one is large for patches with a single strong edge.
    """
    rings = mesh.topology.face_rings(1)
    inconsistency, means = patch_statistics(mesh, rings)
    guide = np.empty_like(means)
    arrays = inconsistency, means, mesh.face_normals, rings, guide
    parallel_for(len(means), _choose_patch, *arrays, smallest=SMALLEST_COSTLY_CHUNK)
    return guide


def patch_statistics(mesh: Mesh, rings: Csr) -> tuple[Vectors, Vectors]:
    """Return H, (m,), and the area-weighted mean normal, (m, 3), of the patch of each face; zero where they cancel."""
    count = len(mesh.faces)
    inconsistency, means = np.empty(count), np.empty((count, 3))
    arrays = mesh.face_normals, mesh.areas, mesh.topology.faces_across, rings, inconsistency, means
    parallel_for(count, _patch_statistics, *arrays, smallest=SMALLEST_COSTLY_CHUNK)
    return inconsistency, means


EPSILON = 1e-9  # keeps the relative saliency of a flat patch finite


@kernel
def _patch_statistics(
    start: int,
    stop: int,
    normals: Vectors,
    areas: Floats,
    across: Ints32,
    rings: Csr,
    inconsistency: Floats,
    means: Vectors,
) -> None:
    inside = np.full(len(normals), -1, np.int32)
    most = 1
    for f in range(start, stop):
        most = max(most, rings.indptr[f + 1] - rings.indptr[f] + 1)
    patch, proper = np.empty(most, np.int32), np.empty((most, 3))
    for f in range(start, stop):
        # the patch: the faces around the face, and itself
        size = rings.indptr[f + 1] - rings.indptr[f] + 1
        for i in range(size):
            patch[i] = rings.indices[rings.indptr[f] + i] if i < size - 1 else f
            inside[patch[i]] = f

        # its mean normal, the widest chord between two normals, and the turns at the edges inside, each counted once
        total = (0.0, 0.0, 0.0)
        widest = saliency = largest = 0.0
        count = 0
        for g in patch[:size]:
            if areas[g] == 0.0:
                continue
            normal = row(normals, g)
            total = add(total, scaled(areas[g], normal))
            for i in range(count):
                widest = max(widest, squared_distance(row(proper, i), normal))
            proper[count, 0], proper[count, 1], proper[count, 2] = normal
            count += 1
            for side in range(3):
                h = across[g, side]
                if h > g and inside[h] == f and areas[h] > 0.0:
                    turn = length(subtract(normal, row(normals, h)))
                    largest = max(largest, turn)
                    saliency += turn

        inconsistency[f] = np.sqrt(widest) * largest / (EPSILON + saliency)
        extent = length(total)
        means[f, 0], means[f, 1], means[f, 2] = scaled(1.0 / extent if extent > 0.0 else 0.0, total)


@kernel
def _choose_patch(
    start: int, stop: int, inconsistency: Floats, means: Vectors, normals: Vectors, rings: Csr, guide: Vectors
) -> None:
    """Choose the patch with the least H, in a tie that of the first neighbour. A zero mean gives the face's normal."""
    for f in range(start, stop):
        best = f
        for k in range(rings.indptr[f], rings.indptr[f + 1]):
            g = rings.indices[k]
            if inconsistency[g] < inconsistency[best] or (inconsistency[g] == inconsistency[best] and best == f):
                best = g
        mean = row(means, best)
        guide[f] = means[best] if dot(mean, mean) > 0.0 else normals[f]
