"""Static/dynamic filtering of face normals (Zhang, Deng, Hong, Peng, Qin, Liu 2018).

The energy of a pair of faces is bounded, however much their normals differ, and weighted by a fixed guidance. The
guidance (static) and the filtered normals (dynamic) therefore decide together what counts as an edge.
"""

from typing import Annotated

import numpy as np

from cascadenorm.baselines.bilateral_normal import joint_bilateral_pass, steepness
from cascadenorm.baselines.guided_normal import GuidedDistance, centroid_distance, faces_within, patch_guidance
from cascadenorm.baselines.vertex_update import Sweeps, VertexFit, fit_vertices
from cascadenorm.execution.progress import track
from cascadenorm.mesh import Csr, Floats, Mesh, Vectors, kernel, parallel_for
from cascadenorm.mesh.vectors import row, squared_distance
from cascadenorm.registry import Parameter, method

SPREADS_REACH = 3.0  # radius of the neighbourhood, in spreads over distance

Smoothness = Annotated[
    float, Parameter("λ, weight of the differences between normals relative to fidelity", minimum=0, maximum=1e6)
]
StaticSpread = Annotated[float, Parameter("Spread over the chord between guidance normals", "chord", minimum=1e-6)]
DynamicSpread = Annotated[
    float, Parameter("Spread over the chord between filtered normals", "chord", minimum=1e-6, maximum=1e6)
]
InnerPasses = Annotated[int, Parameter("Number of passes over the normals in each iteration", minimum=0)]
Iterations = Annotated[int, Parameter("Number of iterations of filter and vertex update", minimum=0)]


@method("static-dynamic-normal", source="Zhang, Deng, Hong, Peng, Qin, Liu 2018", family="normals")
def static_dynamic_normal(
    mesh: Mesh,
    *,
    smoothness: Smoothness = 1.0,
    sigma_s: GuidedDistance = None,
    sigma_g: StaticSpread = 0.3,
    sigma_r: DynamicSpread = 0.6,
    passes: InnerPasses = 8,
    iterations: Iterations = 5,
    sweeps: Sweeps = 10,
    fit: VertexFit = "sweeps",
) -> Vectors:
    """Find normals near the given ones that differ little within regions of a guidance, then fit the vertices to them.

    Formula
    -------
    minimise Σ_f A_f |n_f - n*_f|² + λ' Σ_fg (A_f + A_g) exp(-|c_f - c_g|²/2σ_s² - |γ_f - γ_g|²/2σ_g²) ψ(n_f - n_g)
    ψ(d) = 1 - exp(-|d|²/2σ_r²),   |n_f| = 1,   λ' = λ Σ_f A_f / Σ_fg (A_f + A_g) exp(-|c_f - c_g|²/2σ_s²)
    γ: guidance of `guided-normal`; pairs f, g of faces within 3 σ_s
    each pass: n_f ← unit(2σ_r²/λ' A_f n*_f + Σ_g (A_f + A_g) exp(…) exp(-|n_f - n_g|²/2σ_r²) n_g)

    Limits
    ------
    As with `guided-normal`, features narrower than two rings blur. The energy has many minima, and the passes converge
    to one near the given normals.
    """
    for _ in track(iterations):
        spread = centroid_distance(mesh) if sigma_s is None else sigma_s
        pairs = weighted_pairs(mesh, patch_guidance(mesh), smoothness=smoothness, sigma_s=spread, sigma_g=sigma_g)
        normals = mesh.face_normals
        for _ in range(passes):
            normals = descended(mesh, normals, pairs, sigma_r)
        mesh = mesh.moved(fit_vertices(mesh, normals, fit=fit, sweeps=sweeps))
    return mesh.vertices.copy()


def weighted_pairs(
    mesh: Mesh, guidance: Vectors, *, smoothness: float, sigma_s: float, sigma_g: float
) -> tuple[Csr, Floats]:
    """Return the faces within 3 σ_s of each, and the weight of each such pair in the energy for a guidance, (m, 3).

    The sum over pairs is scaled so that the result does not depend on how many there are. σ_s is in mean edge lengths.
    """
    count, neighbors = len(mesh.faces), faces_within(mesh, SPREADS_REACH * sigma_s)
    parallel_for(count, _sort_rows, neighbors)
    weights, spatial = np.empty(len(neighbors.indices)), np.empty(count)
    over_distance, over_guidance = steepness(sigma_s * mesh.mean_edge_length), steepness(sigma_g)
    arrays = mesh.centroids, mesh.areas, guidance, neighbors
    parallel_for(count, _pair_weights, *arrays, over_distance, over_guidance, weights, spatial)
    pairs = 0.5 * spatial.sum()  # each pair was added up from both sides
    weights *= smoothness * mesh.areas.sum() / pairs if pairs > 0 else 0.0
    return neighbors, weights


def descended(mesh: Mesh, normals: Vectors, pairs: tuple[Csr, Floats], sigma_r: float) -> Vectors:
    """Return (m, 3) unit normals after one pass: each minimises a bound of the energy while all others stay."""
    own = 2 * sigma_r**2 * mesh.areas
    return joint_bilateral_pass(normals, normals, own, *pairs, sigma_r, given=mesh.face_normals)


@kernel
def _sort_rows(start: int, stop: int, neighbors: Csr) -> None:
    for f in range(start, stop):
        neighbors.indices[neighbors.indptr[f] : neighbors.indptr[f + 1]].sort()


@kernel
def _pair_weights(
    start: int,
    stop: int,
    centroids: Vectors,
    areas: Floats,
    guidance: Vectors,
    neighbors: Csr,
    over_distance: float,
    over_guidance: float,
    weights: Floats,
    spatial: Floats,
) -> None:
    """Write the weight of each pair, 0 where only one face has the other as a neighbour; sum those of distance."""
    for f in range(start, stop):
        spatial[f] = 0.0
        for k in range(neighbors.indptr[f], neighbors.indptr[f + 1]):
            g = neighbors.indices[k]
            weights[k] = 0.0
            others = neighbors.indices[neighbors.indptr[g] : neighbors.indptr[g + 1]]
            place = np.searchsorted(others, f)
            if place < len(others) and others[place] == f:
                closeness = np.exp(-over_distance * squared_distance(row(centroids, f), row(centroids, g)))
                alike = np.exp(-over_guidance * squared_distance(row(guidance, f), row(guidance, g)))
                weights[k] = (areas[f] + areas[g]) * closeness * alike
                spatial[f] += (areas[f] + areas[g]) * closeness
