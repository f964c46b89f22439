"""L0 minimisation (He & Schaefer 2013).

The surface bends across as few edges as possible. Thresholding of the bent edges alternates with a linear solve for the
vertices, while the penalty β on other bends grows. The matrix changes with each step, since the operator follows the
vertices, but its sparsity pattern does not and is computed once. Conjugate gradients start from the previous vertices,
which are close to the new ones.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.baselines.edge_operators import EdgeOperator, edge_coefficients, edge_quads, mean_dihedral
from cascadenorm.execution.progress import track
from cascadenorm.geometry.conjugate_gradients import MOST_ITERATIONS, conjugate_gradients
from cascadenorm.mesh import Csr, Floats, Ints32, Mesh, Vectors, kernel, parallel_for
from cascadenorm.registry import Parameter, method

FIRST_BETA, LAST_BETA = 1e-3, 1e3
ACCURACY = 1e-6  # bound on the RMS error of each solution in mean edge lengths, valid since the matrix is ≥ I

Operator = Annotated[
    EdgeOperator, Parameter("Edge operator: area-based, or cotangent, which is unstable on thin triangles")
]
Sparsity = Annotated[
    float,
    Parameter(
        "λ, weight of the L0 norm, which penalises each edge that is not flat",
        "squared mean edge lengths × mean dihedral angle",
        minimum=0,
    ),
]
Regularity = Annotated[
    float,
    Parameter(
        "Initial weight α of the regulariser of triangle shapes, which is halved in each iteration",
        "mean dihedral angle",
        minimum=0,
        below=math.inf,
    ),
]
Growth = Annotated[float, Parameter("Factor by which β grows in each iteration, from 1e-3 to 1e3", minimum=1.01)]


@method("l0", source="He, Schaefer 2013", family="sparsity")
def l0(
    mesh: Mesh,
    *,
    operator: Operator = "area",
    sparsity: Sparsity = 0.2,
    regularity: Regularity = 0.1,
    growth: Growth = 1.414,
) -> Vectors:
    """Make the surface piecewise flat by penalising the number of bent edges.

    The energy also contains the displacement and the unevenness of triangles. Only edges with exactly two faces are
    penalised; vertices without such edges depend only on the displacement term.

    Formula
    -------
    minimise |x - x*|² + α|R x|² + λ|D x|_0,   |·|_0 the number of edges with a difference
    D: area-based operator across each edge, zero where its two faces are coplanar; R: evenness of its four vertices
    solved with auxiliary differences δ: β|D x - δ|² + λ|δ|_0, in turn, while β grows

    Limits
    ------
    Smooth curved surfaces become facets. The problem is not convex, so the result depends on the schedule of β. Heavy
    noise folds faces over.
    """
    dihedral, edge = mean_dihedral(mesh), mesh.mean_edge_length
    price, alpha, beta = sparsity * edge**2 * dihedral, regularity * dihedral, FIRST_BETA
    system = edge_system(edge_quads(mesh.topology), len(mesh.vertices))
    vertices = mesh.vertices.copy()
    right, values = np.empty_like(vertices), np.empty(len(system.pattern.indices))
    bound = len(vertices) * (ACCURACY * edge) ** 2
    for _ in track(math.ceil(math.log(LAST_BETA / FIRST_BETA, growth))):
        coefficients = edge_coefficients(vertices, system.quads, operator)
        _assemble(system, mesh.vertices, vertices, coefficients, alpha, beta, price, values, right)
        conjugate_gradients(system.pattern, values, right, vertices, bound, MOST_ITERATIONS)
        beta *= growth
        alpha *= 0.5
    return vertices


class EdgeSystem(NamedTuple):
    """Positions of the edges' entries in the symmetric matrix of the vertices."""

    pattern: Csr  # sparsity pattern with n rows, columns ascending, including the diagonal
    quads: NDArray[np.int32]  # (e, 4) vertices of each edge
    slots: NDArray[np.int32]  # (e, 4, 4) entry of the pattern for each pair of these vertices
    diagonal: NDArray[np.int32]  # (n,) entry of the pattern on the diagonal


def edge_system(quads: NDArray[np.int32], vertex_count: int) -> EdgeSystem:
    """Compute the sparsity pattern of I + αRᵀR + βDᵀD."""
    everyone = np.arange(vertex_count, dtype=np.int32)
    rows = np.concatenate([np.repeat(quads, 4, axis=1).ravel(), everyone])
    columns = np.concatenate([np.tile(quads, 4).ravel(), everyone])
    matrix = scipy.sparse.csr_array((np.ones(len(rows), np.int8), (rows, columns)), (vertex_count, vertex_count))
    matrix.sort_indices()
    pattern = Csr.of(matrix)
    slots = np.empty(len(rows), np.int32)
    parallel_for(len(rows), _find_slots, pattern, rows, columns, slots)
    return EdgeSystem(pattern, quads, slots[: 16 * len(quads)].reshape(-1, 4, 4), slots[16 * len(quads) :])


@kernel
def _find_slots(start: int, stop: int, pattern: Csr, rows: Ints32, columns: Ints32, slots: Ints32) -> None:
    for i in range(start, stop):
        low, high = pattern.indptr[rows[i]], pattern.indptr[rows[i] + 1]
        slots[i] = low + np.searchsorted(pattern.indices[low:high], columns[i])


@kernel
def _assemble(
    system: EdgeSystem,
    noisy: Vectors,
    vertices: Vectors,
    coefficients: Floats,
    alpha: float,
    beta: float,
    price: float,
    values: Floats,
    right: Vectors,
) -> None:
    """Fill the matrix I + αRᵀR + βDᵀD and the right-hand side x* + βDᵀδ, where δ is Dx on the edges that stay bent."""
    for k in range(len(values)):
        values[k] = 0.0
    for i in range(len(noisy)):
        values[system.diagonal[i]] = 1.0
        for d in range(3):
            right[i, d] = noisy[i, d]

    # Each edge adds to the 4 × 4 entries of its corners, and to the right-hand side only where Dx is kept.
    for e in range(len(system.quads)):
        x = y = z = 0.0
        for a in range(4):
            i, c = system.quads[e, a], coefficients[e, a]
            x += c * vertices[i, 0]
            y += c * vertices[i, 1]
            z += c * vertices[i, 2]
        stays = beta * (x * x + y * y + z * z) > price
        for a in range(4):
            for b in range(4):
                even = alpha if (a - b) % 2 == 0 else -alpha
                values[system.slots[e, a, b]] += even + beta * coefficients[e, a] * coefficients[e, b]
            if stays:
                i, c = system.quads[e, a], beta * coefficients[e, a]
                right[i, 0] += c * x
                right[i, 1] += c * y
                right[i, 2] += c * z
