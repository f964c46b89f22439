"""Move vertices to fit given face normals: by sweeps that flip no face, or all at once by least squares.

The sweeps are those of Sun et al. 2007 and Zheng et al. 2011.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
import scipy

from cascadenorm.geometry.sparse_solvers import DENSE_LIMIT, Factorisation, solve_once
from cascadenorm.mesh import Bools, Csr, Floats, Index, Ints32, Mesh, Vectors, kernel, parallel_for, scatter_add
from cascadenorm.mesh.vectors import Vector, add, cross, divided, dot, row, scaled, subtract
from cascadenorm.registry import Parameter

VertexFit = Annotated[
    Literal["sweeps", "least-squares"],
    Parameter("Update of the vertices: Gauss-Seidel sweeps, or one sparse solve, which may flip faces"),
]
Sweeps = Annotated[int, Parameter("Number of Gauss-Seidel sweeps of the vertex update", minimum=0)]
Weighting = Literal["uniform", "cotangent"]  # weights in the vertex update; see `recover_vertices`
Foldovers = Literal["avoid", "ignore"]  # handling of steps that flip faces against their normals
OVER_RELAXATION = 1.5  # of the steps with cotangent weights
PUBLISHED_RELAXATION = 2 / 3  # a published step goes to the mean of three corners, of which one is the vertex itself
LEAST_HEIGHT = 0.02  # height of a face, relative to its longest side, below which its weights no longer grow
ATTACHMENT = 0.015  # μ, weight of the given positions; a smaller one overfits normals, which fit no surface exactly


def recover_vertices(
    mesh: Mesh,
    normals: Vectors,
    *,
    sweeps: int = 20,
    weighting: Weighting = "uniform",
    foldovers: Foldovers = "avoid",
    movable: Bools | None = None,
) -> Vectors:
    """Move vertices until the faces have the given normals, (m, 3) unit vectors, by Gauss-Seidel sweeps.

    The sweeps minimise Σ_f Σ_k s_fk <n_f, e_fk>² with the three sides e_fk of each face and their weights s_fk from
    `side_weights`. A step is x_i += ω Σ_f (s_fj <n_f, x_j - x_i> + s_fk <n_f, x_k - x_i>) n_f / Σ_f (s_fj + s_fk) with
    the sides from x_i to the other corners j and k of each face f around it.

    With uniform weights and ω = 2/3 this is the published x_i += (1/N_i) Σ_{f∋i} <n_f, c_f - x_i> n_f. The long sides
    of an elongated face then count most, although its normal hardly depends on them, and small errors of the given
    normals become large errors of the faces. With cotangent weights the sum is Σ_f A_f sin² θ_f, where θ_f is the angle
    between n_f and the normal of the face. A_f and the cotangents are those before the update, and ω = 1.5.

    Unless foldovers are ignored, as published, a step that would flip a face against its normal is shortened. Vertices
    of a face that is already flipped are pulled toward the mean of their neighbours until it has the right orientation.
    Each sweep processes the vertices in groups in which no two share a face. Only `movable` vertices, (n,), move; None
    selects all. A face whose normal is a zero row has no influence, and a vertex without a face does not move. Returns
    (n, 3) vertices.
    """
    vertices = mesh.vertices.copy()
    around, colors = mesh.topology.vertex_faces, mesh.topology.vertex_colors
    groups = [colors.row(color) for color in range(len(colors.counts))]
    if movable is not None:
        groups = [group[movable[group]] for group in groups]
    weights, avoid = side_weights(mesh, weighting), foldovers == "avoid"
    relaxation = OVER_RELAXATION if weighting == "cotangent" else PUBLISHED_RELAXATION
    for _ in range(sweeps):
        for mine in groups:
            parallel_for(
                len(mine), _sweep_range, mine, vertices, mesh.faces, normals, weights, relaxation, avoid, around
            )
    return vertices


def side_weights(mesh: Mesh, weighting: Weighting) -> Floats:
    """Return the weight of the side opposite each corner, (m, 3): 1/3, or half the cotangent of the angle there.

    Cotangents of faces lower than LEAST_HEIGHT are computed with that height, which bounds them, and with sides of at
    least that length, so that the two weights at a corner do not cancel. Unlike those of `face_cotangents`, whose
    mollification depends on the whole mesh, they depend on their face only.
    """
    if weighting == "uniform":
        return np.full(mesh.faces.shape, 1 / 3)
    weights = np.zeros(mesh.faces.shape)
    parallel_for(len(weights), _half_cotangents, mesh.vertices, mesh.faces, weights)
    return weights


@kernel
def _half_cotangents(start: int, stop: int, vertices: Vectors, faces: Ints32, out: Floats) -> None:
    for f in range(start, stop):
        a, b, c = row(vertices, faces[f, 0]), row(vertices, faces[f, 1]), row(vertices, faces[f, 2])
        u, v, w = subtract(b, a), subtract(c, b), subtract(a, c)
        double_area = np.sqrt(dot(cross(u, v), cross(u, v)))
        uu, vv, ww = dot(u, u), dot(v, v), dot(w, w)
        longest = max(uu, vv, ww)
        double_area = max(double_area, LEAST_HEIGHT * longest)
        least = LEAST_HEIGHT * LEAST_HEIGHT * longest
        uu, vv, ww = max(uu, least), max(vv, least), max(ww, least)
        if double_area > 0:
            out[f, 0] = 0.25 * (ww + uu - vv) / double_area
            out[f, 1] = 0.25 * (uu + vv - ww) / double_area
            out[f, 2] = 0.25 * (vv + ww - uu) / double_area


@kernel
def _sweep_range(
    start: int,
    stop: int,
    movable: Ints32,
    vertices: Vectors,
    faces: Ints32,
    normals: Vectors,
    weights: Vectors,
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
            corner = 0 if faces[f, 0] == i else 1 if faces[f, 1] == i else 2
            after, before = (corner + 1) % 3, (corner + 2) % 3
            normal = row(normals, f)
            u = subtract(row(vertices, faces[f, after]), place)
            v = subtract(row(vertices, faces[f, before]), place)
            pull = weights[f, before] * dot(normal, u) + weights[f, after] * dot(normal, v)
            total += weights[f, before] + weights[f, after]
            areas[k] = dot(normal, cross(u, v))
            step = add(step, scaled(pull, normal))
            slopes[k, 0], slopes[k, 1], slopes[k, 2] = cross(normal, subtract(v, u))
            flipped += areas[k] < 0

        # The step is the over-relaxed mean of the pulls. The published update always takes it.
        step = scaled(relaxation / total if total > 0 else 0.0, step)
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
    return least_squares_vertices(mesh, normals, weights=side_weights(mesh, weighting))


def least_squares_vertices(mesh: Mesh, normals: Vectors, *, weights: Floats, attachment: float = ATTACHMENT) -> Vectors:
    """Minimise Σ_f Σ_k s_fk <n_f, e_fk>² + μ Σ_i W_i |x_i - x⁰_i|² by one sparse solve.

    n_f are the given unit normals, (m, 3); a face with a zero row has no influence. e_fk are the sides opposite the
    corners of each face and s_fk their weights, (m, 3), as of `side_weights`. Without the second term, the sweeps of
    `recover_vertices` come to the same minimum. This is the least-squares system of Taubin (2001), which Sun et al.
    (2007) and Zheng et al. (2011) solve by descent. W_i is the sum of the weights of the sides at a vertex, face by
    face. The attachment μ makes the solution unique. Faces may flip. Returns (n, 3) vertices; those without a face do
    not move.
    """
    count = len(mesh.vertices)
    around = np.roll(weights, 1, axis=1) + np.roll(weights, 2, axis=1)  # sums of the two sides at each corner
    total = scatter_add(mesh.faces.ravel(), around.ravel(), count)
    total[total == 0] = 1.0  # without a face: only attached

    # <n_f, x_i - x_j> of the side opposite each corner as a row over the coordinates of all vertices
    first, second = np.roll(mesh.faces, -1, axis=1).ravel(), np.roll(mesh.faces, 1, axis=1).ravel()
    along = np.repeat(normals, 3, axis=0)
    axes = np.arange(3)
    columns = np.concatenate([3 * first[:, None] + axes, 3 * second[:, None] + axes], axis=1)
    starts = np.arange(0, columns.size + 1, 6)
    entries = np.concatenate([along, -along], axis=1)
    differences = scipy.sparse.csr_array((entries.ravel(), columns.ravel(), starts), (len(first), 3 * count))
    stiffness = differences.T @ (scipy.sparse.diags_array(weights.ravel()) @ differences)

    pull = np.repeat(attachment * total, 3)
    matrix = scipy.sparse.csr_array(stiffness + scipy.sparse.diags_array(pull))
    right = pull * mesh.vertices.ravel()
    if matrix.nnz <= DENSE_LIMIT:
        solution = Factorisation(matrix, np.repeat(mesh.vertices, 3, axis=0)).solve(right)
    else:
        solution = solve_once(matrix, right)
    return solution.reshape(count, 3)
