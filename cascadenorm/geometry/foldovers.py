"""Displacements that flip no face and fold no edge, except at foldovers."""

import math

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Bools, Floats, Ints32, Mesh, Vectors, kernel, parallel_for
from cascadenorm.mesh.vectors import dot, length, row

STEP_HALVINGS = 8
"""Of the displacement of a vertex whose face would flip, before it returns to where it was."""
STEEPEST_NORMAL = math.sqrt(0.5)
"""Cosine of the angle to the mean normal around it, 45°, up to which no face may flip, however noisy the mesh."""
FOLDED = math.cos(math.radians(105))
"""Cosine of the angle between the normals of two adjacent faces below which the edge is folded."""
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


def without_folds(mesh: Mesh, vertices: Vectors, smooth: NDArray[np.bool_]) -> Vectors:
    """Take back of a displacement what would flip faces, or fold edges of a surface without sharp noise.

    Faces are treated as in `without_flips`. Where the normals of two adjacent faces would end more than 105° from each
    other, and are not in the input, the displacements of their four vertices are halved in the same way. The limit lies
    between square edges and blades.

    Parameters
    ----------
    mesh
        The input, n vertices.
    vertices
        (n, 3), where a method wants them.
    smooth
        (m,) faces whose noise is not independent from vertex to vertex, which would hide blades in the input.

    Returns
    -------
    (n, 3)
    """
    held = ~foldovers(mesh) & (mesh.areas > 0)
    pairs = mesh.topology.face_pairs
    pairs = pairs[smooth[pairs].all(axis=1)]
    pairs = pairs[~_folded(mesh, pairs)]
    halvings = np.zeros(len(vertices), np.uint8)
    while halved_where_flipped(mesh, vertices, held, halvings, pairs).any():
        pass
    return partly_displaced(mesh, vertices, halvings)


def halved_where_flipped(
    mesh: Mesh,
    vertices: Vectors,
    held: NDArray[np.bool_],
    halvings: NDArray[np.uint8],
    pairs: NDArray[np.int32] | None = None,
) -> NDArray[np.bool_]:
    """Count one more halving, in place, for the vertices of faces that flip or fold, (m,), which are returned.

    Parameters
    ----------
    held
        (m,) faces that may not flip.
    halvings
        (n,) of the displacement of each vertex so far.
    pairs
        (p, 2) adjacent faces whose normals may not end more than 105° from each other.
    """
    moved = mesh.moved(partly_displaced(mesh, vertices, halvings))
    flipped = held & (np.einsum("ij,ij->i", moved.area_vectors, mesh.face_normals) <= 0)
    if pairs is not None:
        flipped[pairs[_folded(moved, pairs)]] = True
    back = np.unique(mesh.faces[flipped])
    halvings[back] = np.minimum(halvings[back] + 1, STEP_HALVINGS + 1)
    return np.asarray(flipped)


def _folded(mesh: Mesh, pairs: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return (p,) which pairs of faces have normals more than 105° from each other."""
    one, other = mesh.face_normals[pairs].swapaxes(0, 1)
    return np.asarray(np.einsum("ij,ij->i", one, other) < FOLDED)


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
