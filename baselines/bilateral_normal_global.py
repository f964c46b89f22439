"""Bilateral filtering of face normals by one sparse solve (Zheng, Fu, Au, Tai 2011, global scheme)."""

from typing import Annotated, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.baselines.bilateral_normal import RangeSpread, SpatialSpread, spatial_weights
from cascadenorm.baselines.vertex_fit import VertexFit, fit_vertices
from cascadenorm.baselines.vertex_update import Sweeps
from cascadenorm.geometry.sparse_solvers import solve_preconditioned
from cascadenorm.mesh import Csr, Floats, Mesh, Vectors, kernel, parallel_for, unit
from cascadenorm.mesh.vectors import row, squared_distance
from cascadenorm.registry import Parameter, method

LEAST_AREA = 1e-6  # mean areas; a face without area still gets a normal, from its neighbours

Fidelity = Annotated[
    float, Parameter("λ, weight of fidelity to the input normals relative to smoothness", above=0, maximum=1)
]


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
    The weights are those of the noisy normals throughout, so heavy noise is taken for edges. The cost is that of one
    sparse system of the size of the faces.
    """
    normals = global_normals(mesh, sigma_s=sigma_s, sigma_r=sigma_r, fidelity=fidelity)
    return fit_vertices(mesh, normals, fit=fit, sweeps=sweeps)


def global_normals(mesh: Mesh, *, sigma_s: float, sigma_r: float, fidelity: float) -> Vectors:
    """Minimise (1 - λ) Σ A_f |(Ln)_f|² + λ Σ A_f |n_f - n*_f|², and normalise.

    (Ln)_f is n_f less the bilateral mean of the normals around it, with weights from the given normals n*. The system
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
    """Return L, (m, m) sparse: the value of a face less the bilateral mean of those that share a vertex with it.

    A face whose neighbours all weigh nothing has a row of zeros.
    """
    rings = mesh.topology.face_rings(1)
    weights = spatial_weights(mesh, rings, sigma_s)
    count = len(mesh.faces)
    own = np.empty(count)
    parallel_for(count, _to_difference, mesh.face_normals, rings, 0.5 / sigma_r**2, weights, own)
    means = scipy.sparse.csr_array((weights, rings.indices, rings.indptr), (count, count))
    return scipy.sparse.csr_array(scipy.sparse.diags_array(own) + means)


@kernel
def _to_difference(
    start: int, stop: int, normals: Vectors, rings: Csr, spread: float, weights: Floats, own: Floats
) -> None:
    """Turn spatial weights into the entries of L beside the diagonal, and give those on it."""
    for f in range(start, stop):
        total = 0.0
        for k in range(rings.indptr[f], rings.indptr[f + 1]):
            g = rings.indices[k]
            weights[k] *= np.exp(-spread * squared_distance(row(normals, g), row(normals, f)))
            total += weights[k]
        own[f] = 1.0 if total > 0.0 else 0.0
        for k in range(rings.indptr[f], rings.indptr[f + 1]):
            weights[k] = -weights[k] / total if total > 0.0 else 0.0
