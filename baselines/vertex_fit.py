"""Vertices that fit given face normals: by sweeps of the vertex update, or all at once by least squares."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
import scipy

from cascadenorm.baselines.vertex_update import Weighting, face_weights, recover_vertices
from cascadenorm.geometry.sparse_solvers import DENSE_LIMIT, Factorisation, solve_once
from cascadenorm.mesh import Floats, Mesh, Vectors, scatter_add
from cascadenorm.registry import Parameter

VertexFit = Annotated[
    Literal["sweeps", "least-squares"],
    Parameter("Update of the vertices: Gauss-Seidel sweeps, or one sparse solve, which may flip faces"),
]
ATTACHMENT = 0.01
"""μ, weight of the given positions against the normals; less overfits filtered normals, which belong to no surface."""


def fit_rings(given: Mapping[str, Any], groups: int, filtered: int) -> int | None:
    """Return how many edges away a vertex depends on; each sweep adds an edge for each group of vertices."""
    return filtered + int(given["sweeps"]) * groups if given["fit"] == "sweeps" else None


def filter_rings(given: Mapping[str, Any], groups: int) -> int | None:
    """Return how many edges away a vertex depends on after passes over the faces around each face."""
    return fit_rings(given, groups, given["iterations"])


def fit_vertices(
    mesh: Mesh,
    normals: Vectors,
    *,
    fit: Literal["sweeps", "least-squares"],
    sweeps: int,
    weighting: Weighting = "uniform",
) -> Vectors:
    """Move vertices until the faces take the given normals, (m, 3), in the way that is chosen."""
    if fit == "sweeps":
        return recover_vertices(mesh, normals, sweeps=sweeps, weighting=weighting)
    return least_squares_vertices(mesh, normals, weights=face_weights(mesh, weighting))


def least_squares_vertices(mesh: Mesh, normals: Vectors, *, weights: Floats, attachment: float = ATTACHMENT) -> Vectors:
    """Minimise Σ_f w_f Σ_{i∈f} <n_f, x_i - c_f>² + μ Σ_i W_i |x_i - x⁰_i|² by one sparse solve.

    c_f is the centroid of the face and W_i the sum of w_f around a vertex. The first term is a third of
    Σ_f w_f Σ <n_f, x_i - x_j>² over the sides of the face, the least-squares system of Taubin (2001), which Sun et al.
    (2007) and Zheng et al. (2011) solve by descent; the vertex update has the same stationary points. The attachment μ
    makes the solution unique. Nothing keeps faces from flipping. The normals are (m, 3) unit vectors, or zero for faces
    that do not pull, and the weights w_f, (m,), are positive. Returns (n, 3) vertices; one without a face stays.
    """
    count = len(mesh.vertices)
    total = scatter_add(mesh.faces.ravel(), np.repeat(weights, 3), count)
    total[total == 0] = 1.0  # without a face: only attached

    # <n_f, x_i - x_j> of each side as a row over the coordinates of all vertices
    first, second = mesh.faces.ravel(), np.roll(mesh.faces, -1, axis=1).ravel()
    along = np.repeat(normals, 3, axis=0)
    axes = np.arange(3)
    columns = np.concatenate([3 * first[:, None] + axes, 3 * second[:, None] + axes], axis=1)
    starts = np.arange(0, columns.size + 1, 6)
    entries = np.concatenate([along, -along], axis=1)
    differences = scipy.sparse.csr_array((entries.ravel(), columns.ravel(), starts), (len(first), 3 * count))
    stiffness = differences.T @ (scipy.sparse.diags_array(np.repeat(weights / 3, 3)) @ differences)

    pull = np.repeat(attachment * total, 3)
    matrix = scipy.sparse.csr_array(stiffness + scipy.sparse.diags_array(pull))
    right = pull * mesh.vertices.ravel()
    if matrix.nnz <= DENSE_LIMIT:
        solution = Factorisation(matrix, np.repeat(mesh.vertices, 3, axis=0)).solve(right)
    else:
        solution = solve_once(matrix, right)
    return solution.reshape(count, 3)
