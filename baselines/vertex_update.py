"""Move vertices to fit given face normals: by sweeps that flip no face, or all at once by least squares.

The sweeps are those of Sun et al. 2007 and Zheng et al. 2011.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.geometry.sparse_solvers import DENSE_LIMIT, Factorisation, solve_once
from cascadenorm.mesh import Csr, Floats, Index, Ints32, Mesh, Vectors, kernel, parallel_for, scatter_add
from cascadenorm.mesh.vectors import Vector, add, cross, divided, dot, row, scaled, subtract
from cascadenorm.registry import Parameter

VertexFit = Annotated[
    Literal["sweeps", "least-squares"],
    Parameter("Update of the vertices: Gauss-Seidel sweeps, or one sparse solve, which may flip faces"),
]
Sweeps = Annotated[int, Parameter("Number of Gauss-Seidel sweeps of the vertex update", minimum=0)]
Weighting = Literal["uniform", "inverse-height"]  # weight of each face in the vertex update; see `recover_vertices`
Foldovers = Literal["avoid", "ignore"]  # handling of steps that flip faces against their normals
OVER_RELAXATION = 2.3
LEAST_HEIGHT = 0.05  # height in mean edge lengths below which the weight of a face no longer grows
ATTACHMENT = 0.01  # μ, weight of the given positions; a smaller one overfits filtered normals, which no surface has


def recover_vertices(
    mesh: Mesh,
    normals: Vectors,
    *,
    sweeps: int = 20,
    weighting: Weighting = "uniform",
    foldovers: Foldovers = "avoid",
    movable: NDArray[np.bool_] | None = None,
) -> Vectors:
    """Move vertices until the faces have the given normals: x_i += (1/N_i) Σ_{f∋i} <n_f, c_f - x_i> n_f.

    The (m, 3) normals are unit vectors; a face with a zero row has no influence. Each sweep is Gauss-Seidel: it updates
    one group of vertices that share no face after the other. Only `movable` vertices, (n,), move; None selects all.
    Returns (n, 3) vertices; those without a face do not move.

    The weighting "uniform", as published, minimises the distances of corners from the plane of their face. For a thin
    face these are small even if its normal deviates strongly. "inverse-height" divides them by the height of the face:
    the step is x_i += 2.3 Σ_{f∋i} w_f <n_f, c_f - x_i> n_f / Σ_{f∋i} w_f with w_f from `face_weights`. With this
    over-relaxation, 20 sweeps converge as far as 100 uniform ones.

    Unless foldovers are ignored, as published, a step that would flip a face against its normal is shortened. Vertices
    of a face that is already flipped are pulled toward the mean of their neighbours until it has the right orientation.
    """
    vertices = mesh.vertices.copy()
    around, colors = mesh.topology.vertex_faces, mesh.topology.vertex_colors
    groups = [colors.row(color) for color in range(len(colors.counts))]
    if movable is not None:
        groups = [group[movable[group]] for group in groups]
    weights, avoid = face_weights(mesh, weighting), foldovers == "avoid"
    step = OVER_RELAXATION if weighting == "inverse-height" else 1.0  # factor on the published one
    for _ in range(sweeps):
        for mine in groups:
            parallel_for(len(mine), _sweep_range, mine, vertices, mesh.faces, normals, weights, step, avoid, around)
    return vertices


def face_weights(mesh: Mesh, weighting: Weighting) -> NDArray[np.float64]:
    """Return the weight of each face, (m,): 1, or the inverse of its height in mean edge lengths, at most 20."""
    if weighting == "uniform" or not mesh.mean_edge_length > 0:
        return np.ones(len(mesh.faces))
    return np.asarray(1 / np.maximum(mesh.heights / mesh.mean_edge_length, LEAST_HEIGHT))


@kernel
def _sweep_range(
    start: int,
    stop: int,
    movable: Ints32,
    vertices: Vectors,
    faces: Ints32,
    normals: Vectors,
    weights: Floats,
    relaxation: float,
    avoid: bool,
    around: Csr,
) -> None:
    """Move vertices that share no face, in place. Vertices in later groups use the new positions.

    The signed area of a face along its normal is affine in the position of a corner, so it is evaluated once for all
    step lengths.
    """
    areas, slopes = np.empty(64), np.empty((64, 3))
    for i in movable[start:stop]:
        first, last = around.indptr[i], around.indptr[i + 1]
        if last - first > len(areas):
            areas, slopes = np.empty(last - first), np.empty((last - first, 3))
        place = row(vertices, i)
        step = (0.0, 0.0, 0.0)
        total, flipped = 0.0, 0
        # Each adjacent face pulls the vertex along its normal, toward its plane. Faces that are flipped are counted.
        for k in range(last - first):
            f = around.indices[first + k]
            a, b, c = faces[f]
            if a != i:  # the corners in order, starting at i
                b, c = (c, a) if b == i else (a, b)
            normal = row(normals, f)
            u, v = subtract(row(vertices, b), place), subtract(row(vertices, c), place)
            pull = dot(normal, add(u, v)) / 3.0 * weights[f]
            total += weights[f]
            areas[k] = dot(normal, cross(u, v))
            step = add(step, scaled(pull, normal))
            slopes[k, 0], slopes[k, 1], slopes[k, 2] = cross(normal, subtract(v, u))
            flipped += areas[k] < 0

        # The step is the over-relaxed mean of the pulls. The published update always takes it.
        step = divided(step, total / relaxation)
        if not avoid:
            vertices[i, 0], vertices[i, 1], vertices[i, 2] = add(place, step)
            continue

        # Otherwise flipped faces are unfolded, and the step is halved, at most four times, until it flips no further
        # face.
        if flipped > 0:
            step = add(step, _tangential_pull(vertices, faces, normals, around.indices[first:last], i))
        for _ in range(4):
            count = 0
            for k in range(last - first):
                count += areas[k] + step[0] * slopes[k, 0] + step[1] * slopes[k, 1] + step[2] * slopes[k, 2] < 0
            if count <= flipped:
                vertices[i, 0], vertices[i, 1], vertices[i, 2] = add(place, step)
                break
            step = scaled(0.5, step)


@kernel
def _tangential_pull(vertices: Vectors, faces: Ints32, normals: Vectors, around: Ints32, i: Index) -> Vector:
    """Return half the vector to the mean of the neighbours, without its component along the mean normal."""
    total = normal = (0.0, 0.0, 0.0)
    for f in around:
        normal = add(normal, row(normals, f))
        for corner in range(3):
            if faces[f, corner] != i:
                total = add(total, row(vertices, faces[f, corner]))
    pull = subtract(divided(total, 2.0 * len(around)), row(vertices, i))
    squared = dot(normal, normal)
    if squared > 0:
        pull = subtract(pull, scaled(dot(pull, normal) / squared, normal))
    return scaled(0.5, pull)


def fit_rings(given: Mapping[str, Any], groups: int, filtered: int) -> int | None:
    """Return the receptive field in edges of a filter and the vertex update. A sweep adds an edge for each group."""
    return filtered + int(given["sweeps"]) * groups if given["fit"] == "sweeps" else None


def filter_rings(given: Mapping[str, Any], groups: int) -> int | None:
    """Return the receptive field in edges of passes over the faces around each face and the vertex update."""
    return fit_rings(given, groups, given["iterations"])


def fit_vertices(
    mesh: Mesh,
    normals: Vectors,
    *,
    fit: Literal["sweeps", "least-squares"],
    sweeps: int,
    weighting: Weighting = "uniform",
) -> Vectors:
    """Move vertices until the faces have the given normals, (m, 3), by sweeps or by least squares."""
    if fit == "sweeps":
        return recover_vertices(mesh, normals, sweeps=sweeps, weighting=weighting)
    return least_squares_vertices(mesh, normals, weights=face_weights(mesh, weighting))


def least_squares_vertices(mesh: Mesh, normals: Vectors, *, weights: Floats, attachment: float = ATTACHMENT) -> Vectors:
    """Minimise Σ_f w_f Σ_{i∈f} <n_f, x_i - c_f>² + μ Σ_i W_i |x_i - x⁰_i|² by one sparse solve.

    c_f is the centroid of the face and W_i the sum of w_f around a vertex. The first term is a third of
    Σ_f w_f Σ <n_f, x_i - x_j>² over the sides of the face, the least-squares system of Taubin (2001), which Sun et al.
    (2007) and Zheng et al. (2011) solve by descent; the vertex update has the same stationary points. The attachment μ
    makes the solution unique. Faces may flip. The normals are (m, 3) unit vectors, or zero for faces without influence,
    and the weights w_f, (m,), are positive. Returns (n, 3) vertices; those without a face do not move.
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
