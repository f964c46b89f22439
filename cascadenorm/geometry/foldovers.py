"""Displacements that flip no face, except to undo foldovers."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from cascadenorm.mesh import Bools, Bytes, Floats, Ints32, Mesh, Vectors, kernel, pair_products, parallel_for
from cascadenorm.mesh.averages import averaged
from cascadenorm.mesh.vectors import dot, length, row

STEP_HALVINGS = 8  # halvings of the displacement of a vertex before the vertex returns to its input position
STEEPEST_NORMAL = math.sqrt(0.5)  # a face within 45° of the mean normal around it never counts as a foldover
FOLDOVER_COSINE = math.cos(math.radians(105))  # between adjacent normals; an edge with a smaller cosine is folded
UNFOLDING_ROUNDS = 5  # rounds in which vertices of flipped faces move to the mean of their neighbours
SLIVER = 0.05  # height of a face, in mean edge lengths, below which it is a sliver
LEAST_FLOAT = float(np.finfo(float).tiny)


def without_flips(
    mesh: Mesh, vertices: Vectors, *, may_flip: Bools | None = None, smooth: Bools | None = None
) -> Vectors:
    """Reduce displacements to (n, 3) positions that would flip faces, or fold edges without independent vertex noise.

    If the normal of a face would turn by 90° or more, the displacements of its three vertices are halved repeatedly,
    and finally set to zero. Only faces that `may_flip`, (m,), by default the foldovers of the input including possible
    ones in strong noise (see `foldovers`), may flip. Slivers among them, which a small displacement flips, may do so
    only if they then agree better with the adjacent faces. If the angle between the normals of two adjacent `smooth`
    faces would exceed 105°, and does not in the input, the displacements of their four vertices are reduced in the same
    way. The limit lies between right-angled edges and thin blades. The `smooth` faces, (m,), by default none, are those
    without noise that is independent at each vertex; such noise would hide blades in the input. Before displacements
    are reduced, vertices of smooth faces that flip or fold move to the mean of their neighbours: such faces are often
    slivers of marching cubes or tetrahedra, and unlike shorter displacements, the mean stays on the denoised surface.
    """
    held = ~(foldovers(mesh) if may_flip is None else may_flip) & (mesh.areas > 0)
    pairs = None
    if smooth is not None and smooth.any():
        pairs = mesh.topology.face_pairs
        pairs = pairs[smooth[pairs].all(axis=1)]
        pairs = pairs[~_folded(mesh, pairs)]
        flawed = partial(_flipped_or_folded, mesh, held & smooth, pairs)
        vertices = unfolded(mesh, vertices, flawed, rounds=UNFOLDING_ROUNDS)
    halvings = np.zeros(len(vertices), np.uint8)
    slivers = mesh.heights < SLIVER * mesh.mean_edge_length
    while True:
        while _halve_where_flipped(mesh, vertices, held, halvings, pairs):
            pass
        moved = partly_displaced(mesh, vertices, halvings)
        free = slivers & ~held
        harmful = _harmful_flips(mesh, mesh.moved(moved), free) if free.any() else free
        if not harmful.any():
            return moved
        held |= harmful


def _halve_where_flipped(mesh: Mesh, vertices: Vectors, held: Bools, halvings: Bytes, pairs: Ints32 | None) -> bool:
    """Add one halving, in place, for the vertices of faces that flip or fold; return whether there are any."""
    flipped = _flipped_or_folded(mesh, held, pairs, mesh.moved(partly_displaced(mesh, vertices, halvings)))
    back = np.unique(mesh.faces[flipped])
    halvings[back] = np.minimum(halvings[back] + 1, STEP_HALVINGS + 1)
    return len(back) > 0


def unfolded(mesh: Mesh, vertices: Vectors, flawed: Callable[[Mesh], Bools], *, rounds: int) -> Vectors:
    """Return vertices, (n, 3), after those of flawed faces have moved to the mean of themselves and their neighbours.

    `flawed` returns the flipped or folded faces, (m,), of a mesh with other vertices. There are at most the given
    number of rounds. Vertices on the boundary and those at their place in the input mesh stay.
    """
    free = (vertices != mesh.vertices).any(axis=1) & ~mesh.topology.boundary_vertices
    for _ in range(rounds):
        around = np.unique(mesh.faces[flawed(mesh.moved(vertices))])
        around = around[free[around]]
        if len(around) == 0:
            break
        means = averaged(vertices, mesh.topology.vertex_neighbors, 1)
        vertices = vertices.copy()
        vertices[around] = means[around]
    return vertices


def _flipped_or_folded(mesh: Mesh, held: Bools, pairs: Ints32 | None, moved: Mesh) -> Bools:
    """Return the `held` faces that flip, and the faces of pairs, (p, 2), whose normals differ by more than 105°."""
    flipped = held & _flipped(mesh, moved)
    if pairs is not None:
        flipped[pairs[_folded(moved, pairs)]] = True
    return np.asarray(flipped)


def _flipped(mesh: Mesh, moved: Mesh) -> Bools:
    """Return (m,) faces whose normals turn by 90° or more."""
    return np.asarray(np.einsum("ij,ij->i", moved.area_vectors, mesh.face_normals) <= 0)


def _harmful_flips(mesh: Mesh, moved: Mesh, among: Bools) -> Bools:
    """Return (m,) faces among some that are flipped, but agree no better with the adjacent faces than before."""
    flipped = among & (mesh.areas > 0) & _flipped(mesh, moved)
    if not flipped.any():
        return np.asarray(flipped)
    pairs = mesh.topology.face_pairs
    pairs = pairs[flipped[pairs].any(axis=1)]
    gains = pair_products(moved.face_normals, pairs) - pair_products(mesh.face_normals, pairs)
    one, other = (np.bincount(side, weights=gains, minlength=len(flipped)) for side in pairs.T)
    return np.asarray(flipped & (one + other <= 0))


def _folded(mesh: Mesh, pairs: Ints32) -> Bools:
    """Return (p,) whether the normals of each pair of faces differ by more than 105°."""
    return np.asarray(pair_products(mesh.face_normals, pairs) < FOLDOVER_COSINE)


def partly_displaced(mesh: Mesh, vertices: Vectors, halvings: Bytes) -> Vectors:
    """Return vertices with displacements halved the given number of times, or zero after STEP_HALVINGS halvings."""
    moved, back = vertices.copy(), np.flatnonzero(halvings)
    share = np.where(halvings[back] > STEP_HALVINGS, 0.0, 0.5 ** halvings[back].astype(np.float64))
    moved[back] = mesh.vertices[back] + share[:, None] * (vertices[back] - mesh.vertices[back])
    return moved


def foldovers(mesh: Mesh) -> Bools:
    """Return (m,) whether each face is flipped, or may be flipped given the scatter of the normals around it.

    Let n̄ be the area-weighted mean normal of the faces within two rings, and R its length, which is 1 if they all
    agree. A face is a foldover if <n, n̄ / R> < min(√(1 - R²), cos 45°). On a smooth surface these are the faces more
    than 90° from n̄, in strong noise those more than 45° from it.
    """
    sums = np.concatenate([mesh.area_vectors, mesh.areas[:, None]], axis=1)
    for _ in range(2):
        parallel_for(len(sums), _sum_of_corners_range, mesh.sums_around(sums), mesh.faces, sums)
    out = np.empty(len(sums), bool)
    parallel_for(len(sums), _folded_range, sums, mesh.face_normals, out)
    return out


@kernel
def _sum_of_corners_range(start: int, stop: int, values: Floats, faces: Ints32, out: Floats) -> None:
    for f in range(start, stop):
        a, b, c = faces[f]
        for column in range(values.shape[1]):
            out[f, column] = values[a, column] + values[b, column] + values[c, column]


@kernel
def _folded_range(start: int, stop: int, sums: Floats, normals: Vectors, out: Bools) -> None:
    """Compare each normal with the sum of area vectors around it; the last column is their total area."""
    for f in range(start, stop):
        around = row(sums, f)
        size = length(around)
        share = size / max(sums[f, 3], LEAST_FLOAT)
        scatter = np.sqrt(max(1 - share * share, 0.0))
        out[f] = dot(around, row(normals, f)) < min(scatter, STEEPEST_NORMAL) * size
