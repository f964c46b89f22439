"""Bilateral filtering of face normals, in passes or by one sparse solve (Zheng, Fu, Au, Tai 2011)."""

from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.baselines.vertex_update import Sweeps, VertexFit, filter_rings, fit_vertices
from cascadenorm.compute.elementary import exp
from cascadenorm.execution.progress import track
from cascadenorm.geometry.patches.work import normals_by_patches
from cascadenorm.geometry.sparse_solvers import solve_preconditioned
from cascadenorm.mesh import Csr, Floats, Mesh, Vectors, kernel, parallel_for, unit
from cascadenorm.mesh.vectors import add, divided, length, row, scaled, squared_distance
from cascadenorm.registry import Parameter, method

LEAST_AREA = 1e-6  # mean areas; a face without area still gets a normal, from its neighbours

SpatialSpread = Annotated[float, Parameter("Spread of the spatial weight", "mean edge lengths", minimum=1e-6)]
RangeSpread = Annotated[
    float, Parameter("Spread of the range weight over the chord between unit normals", "chord", minimum=1e-6)
]
Center = Annotated[
    Literal["skip", "count"], Parameter("Whether the average over the neighbours includes the face itself")
]
Passes = Annotated[int, Parameter("Number of passes over the normals", minimum=0)]
Fidelity = Annotated[
    float, Parameter("λ, weight of fidelity to the input normals relative to smoothness", above=0, maximum=1)
]


@method("bilateral-normal", source="Zheng, Fu, Au, Tai 2011 (local scheme)", family="normals", rings=filter_rings)
def bilateral_normal(
    mesh: Mesh,
    *,
    sigma_s: SpatialSpread = 0.7,
    sigma_r: RangeSpread = 0.45,
    iterations: Passes = 10,
    center: Center = "skip",
    sweeps: Sweeps = 8,
    fit: VertexFit = "sweeps",
) -> Vectors:
    """Average each face normal with those of near faces that point in similar directions, then fit the vertices.

    Formula
    -------
    n_f ← unit Σ_g A_g exp(-|c_g - c_f|²/2σ_s²) exp(-|n_g - n_f|²/2σ_r²) n_g,   g shares a vertex with f

    Limits
    ------
    One σ_r applies to the whole mesh: a small one leaves noise, and a large one rounds edges. Under heavy noise, the
    normals no longer show where the edges are.
    """
    filtered = partial(bilateral_normals, sigma_s=sigma_s, sigma_r=sigma_r, iterations=iterations, center=center)
    normals = normals_by_patches(mesh, filtered, receptive_field=iterations)
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps)


def bilateral_normals(
    mesh: Mesh,
    *,
    sigma_s: float,
    sigma_r: float,
    iterations: int,
    ring: int = 1,
    center: Literal["skip", "count"] = "skip",
) -> Vectors:
    """Filter face normals: n_f ← unit Σ_g A_g exp(-|c_g - c_f|²/2σ_s²) exp(-|n_g - n_f|²/2σ_r²) n_g.

    The sum is over the faces g within `ring` steps over shared vertices. σ_s is in mean edge lengths, σ_r is a chord
    between unit normals (0.35 is about 20 degrees), and infinity disables a weight. With the center "count", the face
    itself is included, weighted by its area. With "skip", as in the authors' program, it is left out, so that its own
    noise has no influence. A face whose neighbours have no weight keeps its normal. Returns (m, 3) unit normals.
    """
    rings = mesh.topology.face_rings(ring)
    weights = spatial_weights(mesh, rings, sigma_s)
    own = mesh.areas if center == "count" else np.zeros_like(mesh.areas)
    normals = mesh.face_normals
    for _ in track(iterations):
        normals = joint_bilateral_pass(normals, normals, own, rings, weights, sigma_r)
    return normals


def steepness(sigma: float) -> float:
    """Return 1 / (2 σ²), the factor of squared distances in a Gaussian; 0 for a spread whose square overflows."""
    return 0.5 / (sigma * sigma)  # a power would raise OverflowError


def spatial_weights(mesh: Mesh, rings: Csr, sigma_s: float, areas: NDArray[Any] | None = None) -> NDArray[Any]:
    """Area times Gaussian of the distance of centroids, for each neighbour in `rings`; σ_s is in mean edge lengths.

    Areas (m,) replace those of the faces; the weights have their type.
    """
    areas = mesh.areas if areas is None else areas
    weights = np.empty(len(rings.indices), areas.dtype)
    spread = steepness(sigma_s * mesh.mean_edge_length)
    parallel_for(len(mesh.faces), _spatial_weights, mesh.centroids, areas, rings, spread, weights)
    return weights


def joint_bilateral_pass(
    normals: Vectors,
    guide: Vectors,
    own: NDArray[np.float64],
    rings: Csr,
    weights: NDArray[np.float64],
    sigma_r: float,
    *,
    given: Vectors | None = None,
) -> Vectors:
    """Apply one pass of the filter. The range weight compares guide normals; a bilateral filter is guided by its input.

    The face itself is included with the weight own[f] and its normal, or the one in `given`, which keeps a sequence of
    passes near its start. Where all weights vanish, the face keeps its normal.
    """
    out = np.empty_like(normals)
    given = normals if given is None else given
    spread = steepness(sigma_r)
    parallel_for(len(normals), _bilateral_pass, normals, guide, given, own, rings, weights, spread, out)
    return out


@kernel
def _spatial_weights(
    start: int, stop: int, centroids: Vectors, areas: Floats, rings: Csr, spread: float, weights: Floats
) -> None:
    for f in range(start, stop):
        for k in range(rings.indptr[f], rings.indptr[f + 1]):
            g = rings.indices[k]
            weights[k] = areas[g] * np.exp(-spread * squared_distance(row(centroids, g), row(centroids, f)))


@kernel
def _bilateral_pass(
    start: int,
    stop: int,
    normals: Vectors,
    guide: Vectors,
    given: Vectors,
    own: Floats,
    rings: Csr,
    weights: Floats,
    spread: float,
    out: Vectors,
) -> None:
    shares = np.empty(64)
    for f in range(start, stop):
        first, count = rings.indptr[f], rings.indptr[f + 1] - rings.indptr[f]
        if count > len(shares):
            shares = np.empty(count)

        # the range weight of each neighbour, in a loop of its own, which the compiler vectorises
        for k in range(count):
            shares[k] = -spread * squared_distance(row(guide, rings.indices[first + k]), row(guide, f))
        for k in range(count):
            shares[k] = weights[first + k] * exp(shares[k])

        # the sum of the normals
        total = scaled(own[f], row(given, f))
        for k in range(count):
            total = add(total, scaled(shares[k], row(normals, rings.indices[first + k])))

        # at length 1
        largest = max(abs(total[0]), abs(total[1]), abs(total[2]))
        if 0.0 < largest < 1e-140:  # whose squares vanish
            total = divided(total, largest)
        size = length(total)
        out[f, 0], out[f, 1], out[f, 2] = divided(total, size) if size > 0 else row(normals, f)


@method("bilateral-normal-global", source="Zheng, Fu, Au, Tai 2011 (global scheme)", family="normals")
def bilateral_normal_global(
    mesh: Mesh,
    *,
    sigma_s: SpatialSpread = 1.0,
    sigma_r: RangeSpread = 0.6,
    fidelity: Fidelity = 0.01,
    sweeps: Sweeps = 10,
    fit: VertexFit = "sweeps",
) -> Vectors:
    """Find normals that are bilateral means of each other and near the given ones, then fit the vertices to them.

    Formula
    -------
    minimise (1 - λ) Σ_f A_f |(Ln)_f|² + λ Σ_f A_f |n_f - n*_f|²
    (Ln)_f = n_f - Σ_g w_fg n_g / Σ_g w_fg,   w as in bilateral-normal, from the given normals n*

    Limits
    ------
    The weights are computed once, from the noisy normals, so heavy noise is mistaken for edges. The cost is that of one
    sparse system with a row for each face.
    """
    normals = global_normals(mesh, sigma_s=sigma_s, sigma_r=sigma_r, fidelity=fidelity)
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps)


def global_normals(mesh: Mesh, *, sigma_s: float, sigma_r: float, fidelity: float) -> Vectors:
    """Minimise (1 - λ) Σ A_f |(Ln)_f|² + λ Σ A_f |n_f - n*_f|², and normalise.

    (Ln)_f is n_f minus the bilateral mean of the normals around it, with weights from the given normals n*. The system
    ((1 - λ) LᵀAL + λA) n = λA n* is solved by conjugate gradients, since its factors would not be sparse.
    """
    difference = bilateral_difference(mesh, sigma_s=sigma_s, sigma_r=sigma_r)
    areas = np.maximum(mesh.areas, LEAST_AREA * (mesh.areas.mean() or 1.0))

    def apply(values: NDArray[np.float64]) -> Any:
        return (1 - fidelity) * (difference.T @ (areas * (difference @ values))) + fidelity * areas * values

    diagonal = (1 - fidelity) * (difference.multiply(difference).T @ areas) + fidelity * areas
    system = scipy.sparse.linalg.LinearOperator((len(areas), len(areas)), apply, dtype=np.float64)
    right = fidelity * areas[:, None] * mesh.face_normals
    solution = solve_preconditioned(system, right, lambda residual: residual / diagonal)
    return unit(solution, otherwise=mesh.face_normals)


def bilateral_difference(mesh: Mesh, *, sigma_s: float, sigma_r: float) -> Any:
    """Return L, (m, m) sparse: the value of a face minus the bilateral mean around it; 0 where all weights vanish."""
    rings = mesh.topology.face_rings(1)
    weights = spatial_weights(mesh, rings, sigma_s)
    count = len(mesh.faces)
    own = np.empty(count)
    parallel_for(count, _to_difference, mesh.face_normals, rings, steepness(sigma_r), weights, own)
    means = scipy.sparse.csr_array((weights, rings.indices, rings.indptr), (count, count))
    return scipy.sparse.csr_array(scipy.sparse.diags_array(own) + means)


@kernel
def _to_difference(
    start: int, stop: int, normals: Vectors, rings: Csr, spread: float, weights: Floats, own: Floats
) -> None:
    """Convert spatial weights to the off-diagonal entries of L, in place, and write the entries on the diagonal."""
    for f in range(start, stop):
        total = 0.0
        for k in range(rings.indptr[f], rings.indptr[f + 1]):
            g = rings.indices[k]
            weights[k] *= np.exp(-spread * squared_distance(row(normals, g), row(normals, f)))
            total += weights[k]
        own[f] = 1.0 if total > 0.0 else 0.0
        for k in range(rings.indptr[f], rings.indptr[f + 1]):
            weights[k] = -weights[k] / total if total > 0.0 else 0.0
