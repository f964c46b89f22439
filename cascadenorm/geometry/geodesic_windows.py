"""Exact geodesic distances on a mesh, by windows (Chen & Han 1990, with the filter and queue of Xin & Wang 2009).

A window is an interval of a side of a face that straight lines from one source reach, after the faces between are
unfolded into the plane. It is passed on from face to face, nearest first. Shortest paths turn at no vertex but those
with a total angle above 2π and those at a boundary, which become sources of windows of their own.
"""

import heapq
from typing import Any, NamedTuple

import numpy as np

from cascadenorm.mesh import Bools, Csr, Floats, Ints, Ints32, Mesh, kernel, scatter_add

ROUNDING = 1e-11
"""Relative difference of two distances that may be nothing but rounding."""
GRAZING = 1e-9
"""By how much of its length a side may miss a window whose rays still count as reaching its end."""
NARROW = 1e-12
"""Width of a window, in lengths of its side, below which it is dropped."""


class UnfoldedFaces(NamedTuple):
    """What windows need to know of n vertices and m faces; side 3f + k of face f joins its corners k and k + 1.

    Parameters
    ----------
    faces
        (m, 3).
    lengths
        (3m,) of the sides.
    apexes
        (3m, 2) the third corner of the face, from the first corner of the side along it, and off it.
    side_edges
        (3m,) edge of each side.
    edge_sides
        The sides at each edge.
    vertex_faces
        The faces around each vertex.
    turning
        (n,) whether a shortest path may turn at a vertex.
    """

    faces: Ints32
    lengths: Floats
    apexes: Floats
    side_edges: Ints32
    edge_sides: Csr
    vertex_faces: Csr
    turning: Bools


Queue = list[Any]
"""Windows (nearest distance, side, low, high, x, y, distance of the source): the interval low … high along the side by
which they enter a face, and the source in the plane of that face, x along the side and y off it. A vertex v from which
windows start is there as (distance, -1 - v, 0, …).
"""


class ExactDistances:
    """Exact distances to the nearest of some sources; further sources may be added at any time.

    Parameters
    ----------
    mesh
        n vertices; no face repeats a vertex. An edge may have any number of faces, of any orientation.

    Attributes
    ----------
    values
        (n,) in the unit of the mesh; inf where no source is connected.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.unfolded = unfolded(mesh)
        self.values = np.full(len(mesh.vertices), np.inf)
        # of each side: the least distance of the third corner through it, and where along it that line came through
        self._occupants = np.full((len(self.unfolded.lengths), 2), np.inf)

    def add(self, sources: Ints) -> None:
        """Add sources, (s,) vertices, and lower the distances of what is nearer to them than to those before."""
        _propagate(self.unfolded, sources, self._occupants, self.values)


def unfolded(mesh: Mesh) -> UnfoldedFaces:
    """Return lengths, angles and adjacency of a mesh as windows need them."""
    topology = mesh.topology
    along, back = np.roll(mesh.corners, -1, axis=1) - mesh.corners, np.roll(mesh.corners, -2, axis=1) - mesh.corners
    lengths = np.linalg.norm(along, axis=2)
    dots = np.einsum("fkd,fkd->fk", along, back)
    proper = lengths > 0
    apexes = np.zeros((*lengths.shape, 2))
    np.divide(dots, lengths, out=apexes[..., 0], where=proper)
    np.divide(2 * mesh.areas[:, None], lengths, out=apexes[..., 1], where=proper)
    angles = np.arctan2(2 * mesh.areas[:, None], dots)
    total = scatter_add(mesh.faces.ravel(), angles.ravel(), topology.vertex_count)
    sides = np.argsort(topology.face_edges, axis=None, kind="stable").astype(np.int32)
    return UnfoldedFaces(
        mesh.faces,
        lengths.ravel(),
        apexes.reshape(-1, 2),
        topology.face_edges.ravel(),
        Csr(topology.edge_faces.indptr, sides),
        topology.vertex_faces,
        (total > 2 * np.pi + GRAZING) | _irregular_vertices(mesh),
    )


def _irregular_vertices(mesh: Mesh) -> Bools:
    """Vertices, (n,) bool, whose faces form anything but one closed fan, or have no area."""
    topology, mask = mesh.topology, np.zeros(len(mesh.vertices), bool)
    mask[topology.edges[topology.edge_faces.counts != 2]] = True
    mask[mesh.faces[mesh.areas == 0]] = True
    fans = np.unique(np.stack([mesh.faces.ravel(), topology.fans()], axis=1), axis=0)
    return np.asarray(mask | (np.bincount(fans[:, 0], minlength=len(mask)) > 1))


@kernel
def _propagate(unfolded: UnfoldedFaces, sources: Ints, occupants: Floats, distances: Floats) -> None:
    """Lower distances by windows from further sources."""
    faces, lengths, apexes = unfolded.faces, unfolded.lengths, unfolded.apexes
    queue: Queue = [(0.0, -1, 0.0, 0.0, 0.0, 0.0, 0.0)]  # from which the compiler knows the types
    queue.pop()
    for v in sources:
        if distances[v] > 0.0:
            distances[v] = 0.0
            heapq.heappush(queue, (0.0, np.int64(-1 - v), 0.0, 0.0, 0.0, 0.0, 0.0))

    while len(queue) > 0:
        nearest, side, low, high, x, y, offset = heapq.heappop(queue)
        if side < 0:
            if nearest <= distances[-1 - side]:
                _start_windows(unfolded, -1 - side, distances, queue)
            continue

        # a window that was overtaken while it waited goes no further
        f, k = side // 3, side % 3
        length = lengths[side]
        a, b, c = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
        if _overtaken(distances[a], distances[b], length, low, high, x, y, offset):
            continue

        # where the ray to the third corner comes through: both sides are reached if it is in the window
        apex_x, apex_y = apexes[side]
        entry = x + (apex_x - x) * y / (y + apex_y)
        left, right = entry > low, entry < high
        if low - GRAZING * length <= entry <= high + GRAZING * length:
            reached = offset + np.hypot(apex_x - x, apex_y + y)
            _reach(unfolded, c, reached, distances, queue)
            if left and right:
                if reached <= occupants[side, 0] * (1.0 + ROUNDING):
                    if reached < occupants[side, 0]:
                        occupants[side, 0], occupants[side, 1] = reached, entry
                else:  # beside one that reaches the corner sooner only one part can matter
                    left = entry < occupants[side, 1]
                    right = not left
        if left:
            _pass_beside(unfolded, side, True, low, min(high, entry), x, y, entry, offset, distances, queue)
        if right:  # the same in the mirror
            start, stop = length - high, length - max(low, entry)
            _pass_beside(unfolded, side, False, start, stop, length - x, y, length - entry, offset, distances, queue)


@kernel
def _start_windows(unfolded: UnfoldedFaces, v: int, distances: Floats, queue: Queue) -> None:
    """Reach the neighbours of a vertex along the edges, and what lies behind the opposite sides of its faces."""
    faces = unfolded.faces
    around = unfolded.vertex_faces
    for n in range(around.indptr[v], around.indptr[v + 1]):
        f = around.indices[n]
        for corner in range(3):
            side = 3 * f + corner
            a, b = faces[f, corner], faces[f, (corner + 1) % 3]
            if a == v:
                _reach(unfolded, b, distances[v] + unfolded.lengths[side], distances, queue)
            elif b == v:
                _reach(unfolded, a, distances[v] + unfolded.lengths[side], distances, queue)
            else:
                x, y = unfolded.apexes[side]
                _pass_on(unfolded, side, 0.0, unfolded.lengths[side], x, y, distances[v], distances, queue)


@kernel
def _reach(unfolded: UnfoldedFaces, v: int, distance: float, distances: Floats, queue: Queue) -> None:
    """Lower the distance of a vertex; windows will start there if paths may turn at it."""
    if distance < distances[v]:
        distances[v] = distance
        if unfolded.turning[v]:
            heapq.heappush(queue, (distance, np.int64(-1 - v), 0.0, 0.0, 0.0, 0.0, 0.0))


@kernel
def _pass_beside(
    unfolded: UnfoldedFaces,
    side: int,
    left: bool,
    low: float,
    high: float,
    x: float,
    y: float,
    entry: float,
    offset: float,
    distances: Floats,
    queue: Queue,
) -> None:
    """Pass the rays through low … high on to the side from an end of theirs to the third corner; measured from there.

    The ray to the third corner comes through at entry. That through t meets the new side at the share
    y t / ((entry - t) (y + h) + y t) of its length, where h is the height of the face over the old one.
    """
    if not high - low > NARROW * unfolded.lengths[side]:
        return
    target = 3 * (side // 3) + (side + (2 if left else 1)) % 3
    length = unfolded.lengths[target]
    if not length > 0.0:
        return
    height = y + unfolded.apexes[side, 1]
    start = length * y * low / ((entry - low) * height + y * low)
    stop = length * y * high / ((entry - high) * height + y * high)

    # the source along the new side and off it; the left side runs toward the common end
    apex_x = unfolded.apexes[side, 0] if left else unfolded.lengths[side] - unfolded.apexes[side, 0]
    along, off = (x * apex_x - y * unfolded.apexes[side, 1]) / length, entry * height / length
    if left:
        start, stop, along = length - stop, length - start, length - along
    _pass_on(unfolded, target, start, stop, along, off, offset, distances, queue)


@kernel
def _pass_on(
    unfolded: UnfoldedFaces,
    side: int,
    low: float,
    high: float,
    x: float,
    y: float,
    offset: float,
    distances: Floats,
    queue: Queue,
) -> None:
    """Let a window leave a face by a side and enter the others at its edge, unless it was overtaken."""
    # the part of the side that the window sees, if any
    faces, length, edge = unfolded.faces, unfolded.lengths[side], unfolded.side_edges[side]
    low, high = max(low, 0.0), min(high, length)
    a, b = faces[side // 3, side % 3], faces[side // 3, (side + 1) % 3]
    if not (high - low > NARROW * length and y > 0.0):
        return
    if _overtaken(distances[a], distances[b], length, low, high, x, y, offset):
        return

    # into the queue at the other sides of the edge, which may run the other way
    nearest = offset + np.hypot(max(low - x, 0.0, x - high), y)
    sides = unfolded.edge_sides
    for n in range(sides.indptr[edge], sides.indptr[edge + 1]):
        other = np.int64(sides.indices[n])
        if other == side:
            continue
        if faces[other // 3, other % 3] == a:
            heapq.heappush(queue, (nearest, other, low, high, x, y, offset))
        else:
            heapq.heappush(queue, (nearest, other, length - high, length - low, length - x, y, offset))


@kernel
def _overtaken(
    at_a: float, at_b: float, length: float, low: float, high: float, x: float, y: float, offset: float
) -> bool:
    """Whether the far end of a window is reached sooner through an end of its side: then so is all of it."""
    through_a, through_b = (at_a + high) * (1.0 + ROUNDING), (at_b + length - low) * (1.0 + ROUNDING)
    return bool(offset + np.hypot(high - x, y) > through_a or offset + np.hypot(low - x, y) > through_b)
