"""L0 minimisation of second differences across edges (He & Schaefer 2013).

The surface bends across as few edges as possible. Thresholding of the bent edges alternates with a linear solve for the
vertices, while the penalty β on other bends grows. The matrix changes with each step, since the operator follows the
vertices, but its sparsity pattern does not and is computed once. Conjugate gradients start from the previous vertices,
which are close to the new ones.

A second difference vanishes where the surface is flat. The four vertices of an edge with two faces are numbered as in
the paper: the edge runs from 1 to 3; 2 and 4 are the third vertices of its two faces, to the right and to the left of
that direction.
"""

import math
from typing import Annotated, Literal, NamedTuple

import numpy as np
import scipy

from cascadenorm.execution.progress import track
from cascadenorm.geometry.sparse_solvers import MOST_ITERATIONS, conjugate_gradients
from cascadenorm.mesh import Csr, Floats, Ints32, Mesh, Topology, Vectors, angles_between, kernel, parallel_for
from cascadenorm.mesh.vectors import add, cross, dot, length, row, scaled, subtract
from cascadenorm.registry import Parameter, method

FIRST_BETA, LAST_BETA = 1e-3, 1e3
ACCURACY = 1e-6  # bound on the RMS error of each solution in mean edge lengths, valid since the matrix is ≥ I
LARGEST_WEIGHT = 1e3  # of a vertex at an edge; edges with a larger one are ignored

EdgeOperator = Literal["area", "cotan"]

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
        maximum=1e6,
    ),
]
Growth = Annotated[
    float, Parameter("Factor by which β grows in each iteration, from 1e-3 to 1e3", minimum=1.01, below=math.inf)
]


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
    quads: Ints32  # (e, 4) vertices of each edge
    slots: Ints32  # (e, 4, 4) entry of the pattern for each pair of these vertices
    diagonal: Ints32  # (n,) entry of the pattern on the diagonal


def edge_system(quads: Ints32, vertex_count: int) -> EdgeSystem:
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
        right[i, 0], right[i, 1], right[i, 2] = row(noisy, i)

    # Each edge adds to the 4 × 4 entries of its corners, and to the right-hand side only where Dx is kept.
    for e in range(len(system.quads)):
        bend = (0.0, 0.0, 0.0)
        for a in range(4):
            bend = add(bend, scaled(coefficients[e, a], row(vertices, system.quads[e, a])))
        stays = beta * dot(bend, bend) > price
        for a in range(4):
            for b in range(4):
                even = alpha if (a - b) % 2 == 0 else -alpha
                values[system.slots[e, a, b]] += even + beta * coefficients[e, a] * coefficients[e, b]
            if stays:
                i, pull = system.quads[e, a], scaled(beta * coefficients[e, a], bend)
                right[i, 0], right[i, 1], right[i, 2] = add(row(right, i), pull)


def edge_quads(topology: Topology) -> Ints32:
    """Return the (e, 4) vertices 1 to 4 of each edge with two faces, unless two are equal; 2 is in the first face."""
    ends = topology.edges[topology.interior_edges]
    corners = topology.faces[topology.face_pairs]  # (e, 2, 3)
    apart = (corners != ends[:, None, :1]) & (corners != ends[:, None, 1:])
    proper = (apart.sum(axis=2) == 1).all(axis=1)
    apexes = corners[proper][apart[proper]].reshape(-1, 2)
    quads = np.stack([ends[proper, 0], apexes[:, 0], ends[proper, 1], apexes[:, 1]], axis=1)
    return np.ascontiguousarray(quads[apexes[:, 0] != apexes[:, 1]])


def edge_coefficients(vertices: Vectors, quads: Ints32, operator: EdgeOperator) -> Floats:
    """Return (e, 4) weights of the vertices of each edge, so that D(e)x = Σ_k coefficient_k x_k.

    The cotangent operator is (-cot 231 - cot 134, cot 231 + cot 312, -cot 312 - cot 413, cot 134 + cot 413), of length
    |D(e)x| = 2 sin(γ/2) |x_3 - x_1| for faces that meet at π - γ. The area-based operator is that one times
    2 A_123 A_134 / (|x_3 - x_1|² (A_123 + A_134)), so that no weight grows as a triangle loses its height.
    All weights are zero for edges without length, for those so short that a weight would exceed LARGEST_WEIGHT and,
    with the cotangent operator, for those of a face without area.
    """
    coefficients = np.empty(quads.shape)
    parallel_for(len(quads), _edge_coefficients, vertices, quads, operator == "area", coefficients)
    return coefficients


def mean_dihedral(mesh: Mesh) -> float:
    """Return the mean unsigned angle in radians between the normals of the faces at an edge with two faces."""
    angles = angles_between(*np.moveaxis(mesh.face_normals[mesh.topology.face_pairs], 1, 0))
    return float(angles.mean()) if len(angles) else 0.0


@kernel
def _edge_coefficients(start: int, stop: int, vertices: Vectors, quads: Ints32, by_area: bool, out: Floats) -> None:
    """Compute the weights from the feet of vertices 2 and 4 on the edge, and from their heights over it."""
    for e in range(start, stop):
        i, j, k, l = quads[e]
        # the edge u, the sides v and w to the corners beside it, and twice the areas of the two faces
        u = subtract(row(vertices, k), row(vertices, i))
        v = subtract(row(vertices, j), row(vertices, i))
        w = subtract(row(vertices, l), row(vertices, i))
        squared, right, left = dot(u, u), length(cross(u, v)), length(cross(u, w))

        # the weights of vertices 2 and 4, which balance their heights
        second = fourth = 0.0
        if squared > 0.0:
            if by_area:
                total = right + left
                second = left / total if total > 0.0 else 0.5
                fourth = 1.0 - second
            elif right > 0.0 and left > 0.0:
                second, fourth = squared / right, squared / left
        along = second * dot(u, v) + fourth * dot(u, w)
        third = -along / squared if squared > 0.0 else 0.0
        if max(abs(second), abs(third), abs(fourth), abs(second + third + fourth)) > LARGEST_WEIGHT:
            second = third = fourth = 0.0
        out[e, 0], out[e, 1], out[e, 2], out[e, 3] = -(second + third + fourth), second, third, fourth
