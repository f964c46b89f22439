"""Displacements that flip no face but foldovers."""

import math

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Bools, Floats, Ints32, Mesh, Vectors, kernel, parallel_for
from cascadenorm.mesh.vectors import dot, length, row

STEP_HALVINGS = 8
"""Of the displacement of a vertex whose face would flip, before it returns to where it was."""
STEEPEST_NORMAL = math.sqrt(0.5)
"""Cosine of the angle to the mean normal around it, 45°, up to which no face may flip, however noisy the mesh."""
LEAST_FLOAT = float(np.finfo(float).tiny)


def without_flips(mesh: Mesh, vertices: Vectors, *, may_flip: NDArray[np.bool_] | None = None) -> Vectors:
    """Take back of a displacement what would flip faces.

    Where a face would end with its normal 90° or more from
    that of the input, the displacements of its three vertices are halved until it does not, and dropped in the end;
    only faces that were foldovers, or may have been for all that the noise says, may flip (see `foldovers`).

    Parameters
    ----------
    mesh
        The input, n vertices.
    vertices
        (n, 3), where a method wants them.
    may_flip
        (m,) faces that may; None: the foldovers of the mesh.

    Returns
    -------
    (n, 3)
    """
    held = ~(foldovers(mesh) if may_flip is None else may_flip) & (mesh.areas > 0)
    halvings = np.zeros(len(vertices), np.uint8)
    while halved_where_flipped(mesh, vertices, held, halvings).any():
        pass
    return partly_displaced(mesh, vertices, halvings)


def halved_where_flipped(
    mesh: Mesh, vertices: Vectors, held: NDArray[np.bool_], halvings: NDArray[np.uint8]
) -> NDArray[np.bool_]:
    """Count one more halving, in place, for the vertices of faces that flip, (m,), which are returned.

    Parameters
    ----------
    held
        (m,) faces that may not flip.
    halvings
        (n,) of the displacement of each vertex so far.
    """
    moved = mesh.moved(partly_displaced(mesh, vertices, halvings))
    flipped = held & (np.einsum("ij,ij->i", moved.area_vectors, mesh.face_normals) <= 0)
    back = np.unique(mesh.faces[flipped])
    halvings[back] = np.minimum(halvings[back] + 1, STEP_HALVINGS + 1)
    return np.asarray(flipped)


def partly_displaced(mesh: Mesh, vertices: Vectors, halvings: NDArray[np.uint8]) -> Vectors:
    """Return vertices with their displacements halved so often, and dropped after STEP_HALVINGS of them."""
    moved, back = vertices.copy(), np.flatnonzero(halvings)
    share = np.where(halvings[back] > STEP_HALVINGS, 0.0, 0.5 ** halvings[back].astype(np.float64))
    moved[back] = mesh.vertices[back] + share[:, None] * (vertices[back] - mesh.vertices[back])
    return moved


def foldovers(mesh: Mesh) -> NDArray[np.bool_]:
    """Tell which faces are flipped, or may be for all that the scatter of the normals around them says, (m,).

    With n̄ the mean normal, by area, of the faces within two rings, and R its length, which is 1 where they all agree,
    these are the faces with <n, n̄ / R> < min(√(1 - R²), cos 45°): on a smooth surface those more than 90° from it, in
    strong noise those more than 45°.
    """
    sums = np.concatenate([mesh.area_vectors, mesh.areas[:, None]], axis=1)
    for _ in range(2):
        parallel_for(len(sums), _sum_of_corners_range, mesh.sums_around(sums), mesh.faces, sums)
    out = np.empty(len(sums), bool)
    parallel_for(len(sums), _folded_range, sums, mesh.face_normals, out)
    return out


@kernel
def _sum_of_corners_range(start: int, stop: int, values: Floats, faces: Ints32, out: Floats) -> None:
    """Add what the corners of each face have; numpy makes a copy for each corner, and takes ten times as long."""
    for f in range(start, stop):
        a, b, c = faces[f]
        for column in range(values.shape[1]):
            out[f, column] = values[a, column] + values[b, column] + values[c, column]


@kernel
def _folded_range(start: int, stop: int, sums: Floats, normals: Vectors, out: Bools) -> None:
    """Compare each normal with the sum of those around it, whose last column is their area."""
    for f in range(start, stop):
        around = row(sums, f)
        size = length(around)
        share = size / max(sums[f, 3], LEAST_FLOAT)
        scatter = np.sqrt(max(1 - share * share, 0.0))
        out[f] = dot(around, row(normals, f)) < min(scatter, STEEPEST_NORMAL) * size
