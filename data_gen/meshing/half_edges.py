"""An editable triangle mesh: half-edges in arrays, with collapse, flip and split.

Half-edge h of face h // 3 goes from `origin[h]` to the next corner of that face. Removed faces and vertices keep their
slot (`origin` and `start` become -1) until `mesh_of` compacts the arrays.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Ints, Mesh, kernel, scatter_add
from cascadenorm.mesh.isolation import compacted
from cascadenorm.mesh.vectors import Three, Vector, cross, length, subtract

SMOOTH, CREASE, CORNER = 0, 1, 2  # kinds of vertices: free, on a line of marked edges, and fixed, as at boundaries

RING = 48  # vertices with more neighbours than this are not edited
MOST_FACES_AROUND = 512  # a vertex with more faces counts as not manifold


class HalfEdges(NamedTuple):
    """Half-edges (k): origin, twin (-1 at a boundary), marked. Vertices (n): points, kind, target length, start."""

    origin: NDArray[np.int32]
    twin: NDArray[np.int32]
    marked: NDArray[np.bool_]
    points: NDArray[np.float64]
    kind: NDArray[np.int8]
    length: NDArray[np.float64]
    start: NDArray[np.int32]  # a half-edge that leaves the vertex
    used: NDArray[np.int64]  # numbers of vertices and faces so far, including removed ones


def is_manifold(mesh: Mesh) -> bool:
    """Whether each edge has at most two faces with consistent orientation, and each vertex one fan of few faces."""
    ahead = np.roll(mesh.faces, -1, axis=1)
    directed = mesh.faces.astype(np.int64) * mesh.topology.vertex_count + ahead
    if len(np.unique(directed)) < directed.size or (mesh.faces == ahead).any():
        return False
    one_fan_each = mesh.topology.fans().max() + 1 == mesh.topology.used_vertices.sum()
    return bool(one_fan_each and mesh.topology.vertex_faces.counts.max() <= MOST_FACES_AROUND)


def half_edges_of(mesh: Mesh, *, creases: NDArray[np.bool_] | None = None, capacity: float = 3.0) -> HalfEdges:
    """Lay out a mesh for editing, with room for `capacity` times its faces.

    Edges with a true value in `creases`, one per topological edge, are marked, and so are boundary edges. A vertex with
    two marked edges in nearly the same direction lies on a crease. A vertex with any other number of marked edges is a
    corner.
    """
    n, m = len(mesh.vertices), len(mesh.faces)
    rooms = int(capacity * m) + 8
    origin = np.full(3 * rooms, -1, np.int32)
    origin[: 3 * m] = mesh.faces.ravel()
    topology = mesh.topology
    order = np.argsort(topology.face_edges, axis=None, kind="stable")
    edge = topology.face_edges.ravel()[order]
    same = np.flatnonzero(edge[1:] == edge[:-1])
    twin = np.full(3 * rooms, -1, np.int32)
    twin[order[same]], twin[order[same + 1]] = order[same + 1], order[same]

    marked_edge = topology.edge_faces.counts == 1
    if creases is not None:
        marked_edge |= creases
    marked = np.zeros(3 * rooms, bool)
    marked[: 3 * m] = marked_edge[topology.face_edges.ravel()]

    points = np.zeros((n + (rooms - m) // 2 + 8, 3))
    points[:n] = mesh.vertices
    start = np.full(len(points), -1, np.int32)
    start[mesh.faces.ravel()[::-1]] = np.arange(3 * m, dtype=np.int32)[::-1]
    kind = np.zeros(len(points), np.int8)
    kind[:n] = _kinds(mesh, marked_edge)
    return HalfEdges(origin, twin, marked, points, kind, np.zeros(len(points)), start, np.array([n, m], np.int64))


def mesh_of(half_edges: HalfEdges) -> Mesh:
    """Compact the remaining faces and vertices."""
    faces = half_edges.origin[: 3 * half_edges.used[1]].reshape(-1, 3)
    return compacted(half_edges.points, faces[faces[:, 0] >= 0])[0]


def _kinds(mesh: Mesh, marked_edge: NDArray[np.bool_]) -> NDArray[np.int8]:
    ends = mesh.topology.edges[marked_edge]
    degree = np.bincount(ends.ravel(), minlength=len(mesh.vertices))
    along = mesh.vertices[ends[:, 1]] - mesh.vertices[ends[:, 0]]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-300)
    bend = scatter_add(ends.T.ravel(), np.concatenate([along, -along]), len(mesh.vertices))
    kind = np.where(degree == 0, SMOOTH, CORNER).astype(np.int8)
    kind[(degree == 2) & (np.linalg.norm(bend, axis=1) < 0.9)] = CREASE
    kind[mesh.topology.boundary_vertices] = CORNER
    return kind


@kernel
def after(h: int) -> int:
    """Return the next half-edge of the face."""
    return h - 2 if h % 3 == 2 else h + 1


@kernel
def before(h: int) -> int:
    """Return the previous half-edge of the face."""
    return h + 2 if h % 3 == 0 else h - 1


@kernel
def leaving(c: HalfEdges, v: int, ring: Ints) -> tuple[int, bool]:
    """Write the half-edges that leave v; return their number, 0 if too many, and whether they form a closed ring."""
    first = c.start[v]
    h, count = first, 0
    while h != -1:
        if count == len(ring):
            return 0, False
        ring[count] = h
        count += 1
        h = c.twin[before(h)]
        if h == first:
            return count, True
    h = c.twin[first]
    while h != -1:
        if count == len(ring):
            return 0, False
        ring[count] = after(h)
        count += 1
        h = c.twin[after(h)]
    return count, False


@kernel
def are_joined(c: HalfEdges, a: int, b: int, ring: Ints) -> bool:
    """Whether an edge joins a and b. True as well if a has too many neighbours to check."""
    count, _ = leaving(c, a, ring)
    for i in range(count):
        if c.origin[after(ring[i])] == b or c.origin[before(ring[i])] == b:
            return True
    return count == 0


@kernel
def doubled_area_vector(p: Three, q: Three, r: Three) -> Vector:
    """Return twice the area of a triangle times its normal."""
    return cross(subtract(q, p), subtract(r, p))


@kernel
def distance(p: Three, q: Three) -> float:
    """Return the distance between two points."""
    return length(subtract(p, q))


@kernel
def shape(p: Three, q: Three, r: Three) -> float:
    """Return the quality of a triangle: 1 for an equilateral one, 0 for a degenerate one."""
    sides = distance(p, q) ** 2 + distance(q, r) ** 2 + distance(r, p) ** 2
    quality: float = 2 * np.sqrt(3.0) * length(doubled_area_vector(p, q, r)) / max(sides, 1e-300)
    return quality


@kernel
def tie(c: HalfEdges, h: int, g: int, mark: bool) -> None:
    """Make two half-edges twins. Either may be missing."""
    if h != -1:
        c.twin[h] = g
        c.marked[h] = mark
    if g != -1:
        c.twin[g] = h
        c.marked[g] = mark


@kernel
def collapse_keeps_manifold(c: HalfEdges, h: int, ring: Ints, other: Ints) -> bool:
    """Whether the ends of h share only two neighbours, and the vertex to be removed is not on the boundary."""
    a, b = c.origin[h], c.origin[after(h)]
    g = c.twin[h]
    if g == -1:
        return False
    count, closed = leaving(c, a, ring)
    if not closed or count < 3 or count > RING // 2:
        return False
    # The two vertices opposite the edge lose one neighbour each; the merged vertex has the neighbours of both ends.
    left, right = c.origin[before(h)], c.origin[before(g)]
    for v in (left, right):
        around, whole = leaving(c, v, other)
        if around == 0 or (whole and around < 4):
            return False
    around, whole = leaving(c, b, other)
    if around == 0 or around > RING // 2 or (whole and count + around < 7):
        return False
    # A third common neighbour would create an edge with four faces.
    for i in range(count):
        w = c.origin[after(ring[i])]
        if w in (left, right, b):
            continue
        for j in range(around):
            if c.origin[after(other[j])] == w or c.origin[before(other[j])] == w:
                return False
    return True


@kernel
def collapse(c: HalfEdges, h: int, ring: Ints) -> None:
    """Merge the origin of h into its other end. The caller has checked that the mesh stays a manifold."""
    g = c.twin[h]
    a, b = c.origin[h], c.origin[after(h)]
    left, right = c.origin[before(h)], c.origin[before(g)]
    count, _ = leaving(c, a, ring)
    for i in range(count):
        c.origin[ring[i]] = b
    outer, inner = c.twin[after(h)], c.twin[before(h)]
    tie(c, outer, inner, c.marked[after(h)] or c.marked[before(h)])
    c.start[b] = inner
    c.start[left] = outer if outer != -1 else after(inner)
    inner, outer = c.twin[after(g)], c.twin[before(g)]
    tie(c, inner, outer, c.marked[after(g)] or c.marked[before(g)])
    c.start[right] = inner
    c.start[a] = -1
    for face in (h // 3, g // 3):
        c.origin[3 * face : 3 * face + 3] = -1


@kernel
def flip(c: HalfEdges, h: int) -> None:
    """Replace the edge between two faces by the other diagonal. The caller has checked that this is allowed."""
    g = c.twin[h]
    a, b, left, right = c.origin[h], c.origin[after(h)], c.origin[before(h)], c.origin[before(g)]
    sides = (c.twin[after(g)], c.twin[before(h)], c.twin[before(g)], c.twin[after(h)])
    marks = (c.marked[after(g)], c.marked[before(h)], c.marked[before(g)], c.marked[after(h)])
    p, q = 3 * (h // 3), 3 * (g // 3)
    c.origin[p], c.origin[p + 1], c.origin[p + 2] = a, right, left
    c.origin[q], c.origin[q + 1], c.origin[q + 2] = right, b, left
    tie(c, p, sides[0], marks[0])
    tie(c, p + 2, sides[1], marks[1])
    tie(c, q, sides[2], marks[2])
    tie(c, q + 1, sides[3], marks[3])
    tie(c, p + 1, q + 2, False)
    c.start[a], c.start[right], c.start[left], c.start[b] = p, p + 1, p + 2, q + 1


@kernel
def split(c: HalfEdges, h: int, m: int) -> None:
    """Insert vertex m, whose data the caller has set, on an edge, which splits both faces."""
    g, a, b, mark = c.twin[h], c.origin[h], c.origin[after(h)], c.marked[h]
    p, r = _split_face(c, h, m)
    q, s = (-1, -1) if g == -1 else _split_face(c, g, m)
    tie(c, p, s, mark)
    tie(c, r, q, mark)
    c.start[a], c.start[m], c.start[b] = p, r, r + 1


@kernel
def _split_face(c: HalfEdges, h: int, m: int) -> tuple[int, int]:
    """Split the face of h at vertex m of that edge; return the half-edges from its start to m, and from m to its end.

    The face keeps the half up to m, and a new face gets the other one.
    """
    a, b, opposite = c.origin[h], c.origin[after(h)], c.origin[before(h)]
    outer, outer_mark = c.twin[after(h)], c.marked[after(h)]
    inner, inner_mark = c.twin[before(h)], c.marked[before(h)]
    p, r = 3 * (h // 3), 3 * c.used[1]
    c.used[1] += 1
    c.origin[p], c.origin[p + 1], c.origin[p + 2] = a, m, opposite
    c.origin[r], c.origin[r + 1], c.origin[r + 2] = m, b, opposite
    tie(c, p + 2, inner, inner_mark)
    tie(c, r + 1, outer, outer_mark)
    tie(c, p + 1, r + 2, False)
    c.start[opposite] = p + 2
    return p, r
