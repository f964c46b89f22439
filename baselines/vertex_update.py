"""Vertices that fit given face normals (Sun et al. 2007; Zheng et al. 2011), without flipping a face."""

from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Csr, Floats, Index, Ints32, Mesh, Vectors, kernel, parallel_for
from cascadenorm.mesh.vectors import Vector, add, cross, divided, dot, row, scaled, subtract
from cascadenorm.registry import Parameter

Sweeps = Annotated[int, Parameter("Gauss-Seidel sweeps of the vertex update", minimum=0)]
Weighting = Literal["uniform", "inverse-height"]
"""How much each face counts in the vertex update; see `recover_vertices`."""
Foldovers = Literal["avoid", "ignore"]
"""What the vertex update does about faces that a step flips against their normal; see `recover_vertices`."""
LEAST_HEIGHT = 0.05
"""In mean edge lengths: flatter faces count no more than those of this height."""


def recover_vertices(
    mesh: Mesh,
    normals: Vectors,
    *,
    sweeps: int = 20,
    weighting: Weighting = "uniform",
    foldovers: Foldovers = "avoid",
    movable: NDArray[np.bool_] | None = None,
) -> Vectors:
    """Move vertices until the faces take the given normals: x_i += (1/N_i) Σ_{f∋i} <n_f, c_f - x_i> n_f.

    With weighting = "inverse-height" it is x_i += 2.3 Σ_{f∋i} w_f <n_f, c_f - x_i> n_f / Σ_{f∋i} w_f with w_f from
    `face_weights`. Unless foldovers are ignored, a step that would flip a face against its normal is shortened, and the
    vertices of a face that is flipped already are pulled toward the middle of their neighbours until it lies right.

    Parameters
    ----------
    mesh
        n vertices, m faces.
    normals
        (m, 3), unit; a face with a zero row does not pull.
    sweeps
        Gauss-Seidel sweeps, over one group of vertices that share no face after the other; 0 returns a copy of the
        vertices.
    weighting
        "uniform", as published, minimises the distances of corners from the plane of their face, which are small for a
        thin face even where its normal is far off; "inverse-height" divides them by the height of the face, and
        over-relaxes, so that 20 sweeps converge as far as 100.
    foldovers
        "avoid", or "ignore", as published, where each step is the whole sum whatever faces it flips.
    movable
        (n,) the vertices that move; None: all.

    Returns
    -------
    (n, 3) float64; a vertex without a face stays
    """
    vertices = mesh.vertices.copy()
    around, colors = mesh.topology.vertex_faces, mesh.topology.vertex_colors
    groups = [colors.row(color) for color in range(len(colors.counts))]
    if movable is not None:
        groups = [group[movable[group]] for group in groups]
    weights, step, avoid = face_weights(mesh, weighting), _over_relaxation(weighting), foldovers == "avoid"
    for _ in range(sweeps):
        for mine in groups:
            parallel_for(len(mine), _sweep_range, mine, vertices, mesh.faces, normals, weights, step, avoid, around)
    return vertices


def face_weights(mesh: Mesh, weighting: Weighting) -> NDArray[np.float64]:
    """How much each face pulls at its vertices, (m,): 1, or one over its height in mean edge lengths, 20 at most."""
    if weighting == "uniform" or not mesh.mean_edge_length > 0:
        return np.ones(len(mesh.faces))
    return np.asarray(1 / np.maximum(mesh.heights / mesh.mean_edge_length, LEAST_HEIGHT))


def _over_relaxation(weighting: Weighting) -> float:
    """Return the length of a step against the published one."""
    return 2.3 if weighting == "inverse-height" else 1.0


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
    """Move vertices that share no face, in place; those moved later see where these went.

    The area of a face along its normal is affine in the place of a corner: it is read once, for all lengths of a step.
    """
    areas, slopes = np.empty(64), np.empty((64, 3))
    for i in movable[start:stop]:
        first, last = around.indptr[i], around.indptr[i + 1]
        if last - first > len(areas):
            areas, slopes = np.empty(last - first), np.empty((last - first, 3))
        place = row(vertices, i)
        step = (0.0, 0.0, 0.0)
        total, flipped = 0.0, 0
        # each face around pulls the vertex along its normal, towards its plane; those that face against it are counted
        for k in range(last - first):
            f = around.indices[first + k]
            a, b, c = faces[f]
            if a != i:  # without a loop, whose end is hard to predict: a quarter faster where corners begin anywhere
                b, c = (c, a) if b == i else (a, b)
            normal = row(normals, f)
            u, v = subtract(row(vertices, b), place), subtract(row(vertices, c), place)
            pull = dot(normal, add(u, v)) / 3.0 * weights[f]
            total += weights[f]
            areas[k] = dot(normal, cross(u, v))
            step = add(step, scaled(pull, normal))
            slopes[k, 0], slopes[k, 1], slopes[k, 2] = cross(normal, subtract(v, u))
            flipped += areas[k] < 0

        # the mean of the pulls, over-relaxed; the published update goes there in any case
        step = divided(step, total / relaxation)
        if not avoid:
            vertices[i, 0], vertices[i, 1], vertices[i, 2] = add(place, step)
            continue

        # else flipped faces unfold, and the step is halved until it flips no further face, four times at most
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
    """Return half the way to the mean of the neighbours, less its part along the mean normal."""
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
