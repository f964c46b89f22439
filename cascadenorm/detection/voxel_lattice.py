"""Detection of the voxel lattice that a mesh was extracted from."""

from itertools import combinations

import numpy as np

from cascadenorm.mesh import Floats, Ints, Mesh, Vectors, scatter_add

VoxelLattice = Floats  # (3, 3), the edge vectors of a voxel as rows

MOST_EDGES = 20_000  # number of edges from which only some are evaluated
SAME_VECTOR = 2e-3  # bin width in mean edge lengths for equal edge vectors and coordinates
RESOLUTION = 0.02  # bin width in median edge lengths for equal edge vectors in `lattice_share`
MOST_MULTIPLES = 1e6  # largest multiple of a bin width: three numbers below 2^20 form one key
FREQUENT_VECTORS = 64  # vectors that cover nearly all edges on a lattice; binary marching cubes have about 50
FEWEST_LATTICE_EDGES = 1000  # edges required to detect a lattice
DIRECTIONS = 80  # largest number of distinct edge vectors up to sign; marching cubes on a mask have about 50
COVERED_EDGES = 0.9  # least fraction of the edges with these vectors
IN_CELLS = 0.05  # largest fraction of vertices inside cells, where marching cubes may place one in ambiguous cells
ON_NODES = 0.5
"""Least fraction of the vertices on planes of nodes along each axis; marching cubes place two thirds there."""


def some_edge_vectors(mesh: Mesh) -> Vectors:
    """Return the vectors of MOST_EDGES to twice as many edges, (e, 3), evenly spaced in order; of all if few."""
    edges = mesh.topology.edges
    ends = edges[:: max(1, len(edges) // MOST_EDGES)]
    return np.asarray(mesh.vertices[ends[:, 1]] - mesh.vertices[ends[:, 0]])


def lattice_share(mesh: Mesh) -> float:
    """Return the fraction of edges with the most frequent vectors: near 1 for meshes on a lattice, otherwise near 0."""
    vectors, size = some_edge_vectors(mesh), RESOLUTION * mesh.median_edge_length
    if len(vectors) < FEWEST_LATTICE_EDGES or size == 0:
        return 0.0
    counts = np.unique(_keys(vectors, size)[0], return_counts=True)[1]
    return float(np.sort(counts)[-FREQUENT_VECTORS:].sum() / len(vectors))


def lattice_of_mask(mesh: Mesh) -> VoxelLattice | None:
    """Return the voxel lattice, in any rotation, of a binary mask meshed with marching cubes; None for other meshes.

    The vertices are midpoints of lattice edges. The edges of the mesh are therefore sums of few half lattice vectors,
    and relative to one vertex, all others lie at three positions of the half-lattice.
    """
    edge = mesh.mean_edge_length
    if not edge > 0:
        return None
    vectors = _distinct_edges(mesh, edge)
    if vectors is None:
        return None
    sums = np.concatenate([vectors, *(vectors + sign * vectors[:, None] for sign in (1, -1))], axis=None)
    candidates = _different(sums.reshape(-1, 3), edge)
    used = mesh.vertices[mesh.topology.used_vertices]
    offsets = used[:: max(1, len(used) // 2000)] - used[0]
    for lattice in _orthogonal_triples(candidates):
        if _in_the_middle_of_edges(offsets, lattice):
            return lattice
    return None


def _distinct_edges(mesh: Mesh, edge: float) -> Vectors | None:
    """Return the distinct edge vectors up to sign, or None if there are too many."""
    vectors = some_edge_vectors(mesh)
    keys, sign = _keys(vectors, SAME_VECTOR * edge)
    _, number, counts = np.unique(keys, return_inverse=True, return_counts=True)
    common = np.argsort(-counts, kind="stable")[:DIRECTIONS]
    if counts[common].sum() < COVERED_EDGES * len(keys):
        return None
    totals = scatter_add(number.ravel(), vectors * sign, len(counts))
    return np.asarray((totals / counts[:, None])[common])


def _keys(vectors: Vectors, size: float) -> tuple[Ints, Ints]:
    """Round vectors, (n, 3), to multiples of a size and encode each as an integer, equal for opposite vectors.

    Returns (n,) keys, ordered as the coordinates, and the (n, 1) sign that maps each vector to the one of its key. It
    is the sign of the first nonzero coordinate.
    """
    cells = np.rint(np.clip(vectors / size, -MOST_MULTIPLES, MOST_MULTIPLES)).astype(np.int64)
    sign = np.sign(np.take_along_axis(cells, (cells != 0).argmax(axis=1)[:, None], axis=1))
    return (cells * sign) @ np.array([1 << 42, 1 << 21, 1]), sign


def _different(vectors: Vectors, edge: float) -> Vectors:
    """Return the distinct nonzero vectors up to sign, shortest first."""
    _, first = np.unique(_keys(vectors, 4 * SAME_VECTOR * edge)[0], return_index=True)
    kept = vectors[first]
    lengths = np.linalg.norm(kept, axis=1)
    kept, lengths = kept[lengths > 0.1 * edge], lengths[lengths > 0.1 * edge]
    return np.asarray(kept[np.argsort(lengths, kind="stable")])


def _orthogonal_triples(vectors: Vectors) -> list[VoxelLattice]:
    """Return triples of perpendicular vectors among the shortest ones, sorted by volume."""
    few = vectors[:200]
    lengths = np.linalg.norm(few, axis=1)
    perpendicular = np.abs(few @ few.T) < 0.01 * np.outer(lengths, lengths)
    triples = []
    for a, b in combinations(range(len(few)), 2):
        if perpendicular[a, b]:
            third = np.flatnonzero(perpendicular[a] & perpendicular[b])
            triples += [(a, b, int(c)) for c in third[third > b]]
    triples.sort(key=lambda triple: float(np.prod(lengths[list(triple)])))
    return [few[list(triple)] for triple in triples[:2000]]


def _in_the_middle_of_edges(offsets: Vectors, lattice: VoxelLattice) -> bool:
    """Return whether vertices, relative to one of them, lie at the midpoints of lattice edges."""
    halves = 2 * offsets @ np.linalg.inv(lattice)
    near = np.round(halves)
    if np.abs(halves - near).max() > 0.05:
        return False
    places, counts = np.unique(near.astype(np.int64) % 2, axis=0, return_counts=True)
    places = places[counts > IN_CELLS * len(near)]
    if len(places) != 3:  # one for the edges along each axis
        return False
    return bool((np.abs(places[:, None] - places[None]).sum(axis=2)[np.triu_indices(3, 1)] == 2).all())


def lattice_of_grey_values(mesh: Mesh) -> VoxelLattice | None:
    """Return the lattice of an isosurface of an axis-aligned grey volume; None for other meshes.

    Marching cubes place each vertex on a lattice edge, so two of its coordinates are those of nodes.
    """
    edge = mesh.mean_edge_length
    used = mesh.vertices[mesh.topology.used_vertices]
    if not edge > 0 or len(used) < 100:
        return None
    spacings = [_even_spacing(used[:, axis], edge) for axis in range(3)]
    if any(spacing is None for spacing in spacings):
        return None
    return np.diag(np.array(spacings, np.float64))


def _even_spacing(values: Floats, edge: float) -> float | None:
    """Return the spacing of the values shared by many vertices, or None.

    These values must be evenly spaced and cover enough of the vertices (see ON_NODES).
    """
    cells, counts = np.unique(np.round(values / (SAME_VECTOR * edge)).astype(np.int64), return_counts=True)
    shared = counts > 8 * max(1.0, np.median(counts))
    if shared.sum() < 4 or counts[shared].sum() < ON_NODES * len(values):
        return None
    gaps = np.diff(cells[shared]) * SAME_VECTOR * edge
    gaps = gaps[gaps > 0.2 * edge]
    if len(gaps) < 3:
        return None
    spacing = float(np.median(gaps))
    near = np.abs(gaps / spacing - np.round(gaps / spacing)) < 0.02
    return spacing if near.mean() > 0.9 else None
