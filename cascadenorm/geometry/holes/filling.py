"""Holes of a mesh: their loops found, triangulated, refined to the density around them, and faired (Liepa 2003)."""

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ParameterError
from cascadenorm.geometry.fairing import fair
from cascadenorm.geometry.holes.refinement import refine
from cascadenorm.geometry.holes.triangulation import triangulate_loop
from cascadenorm.geometry.laplacians import Order
from cascadenorm.mesh import Mesh, connected_components, in_frame, scatter_add, without_lines

FAIRINGS = 5  # solutions with a new Laplacian each, from a membrane to the order wanted

OUTER = 2 * math.pi
"""Square of the length of a boundary over the area of its component from which on it is an outer one.

That of a hemisphere is 2π and that of a disk 4π; a sphere with a small hole has much less.
"""

STRAIGHTENED = range(-2, 3)
"""Neighbours along a loop whose mean is taken before its length: zigzags of triangles and noise do not count."""

Outer = Literal["keep", "fill"]


class Holes(NamedTuple):
    """The boundary loops of a mesh, each by its vertices.

    Parameters
    ----------
    closed
        Loops that are closed.
    outer
        Outer boundaries of open components, which are kept.
    long
        Further loops of more edges than are closed, which are kept.
    """

    closed: list[NDArray[np.int32]]
    outer: list[NDArray[np.int32]]
    long: list[NDArray[np.int32]]


def fill_holes(mesh: Mesh, *, order: Order = 2, max_edges: int | None = None, outer: Outer = "keep") -> Mesh:
    """Close the holes of a mesh by patches as dense as the mesh around them.

    Existing vertices and faces keep their positions and numbers; those of the patches come after them.

    Parameters
    ----------
    mesh
        An edge with a single face belongs to a hole or to an outer boundary. A chain of such edges that does not close,
        as between faces of opposite orientation, is left open.
    order
        1 membrane, 2 thin plate, which continues the tangents, 3 minimum variation, which continues the curvature.
    max_edges
        Longest hole that is filled; None fills all.
    outer
        "keep" leaves the outer boundary of an open surface, such as a scan from one side: the longest boundary of a
        component, where it is longer than that of a hemisphere of the same area. "fill" closes it like a hole.

    Raises
    ------
    ParameterError
        Order is not 1, 2 or 3, max_edges is below 3, or outer is another word.
    """
    return filled(mesh, order=order, max_edges=max_edges, outer=outer)[0]


def filled(mesh: Mesh, *, order: Order, max_edges: int | None, outer: Outer) -> tuple[Mesh, Holes]:
    """Close the holes of a mesh as `fill_holes` does, and return which were closed and which were kept."""
    if order not in (1, 2, 3):
        raise ParameterError(f"order is {order!r}; it must be 1, 2 or 3")
    if max_edges is not None and max_edges < 3:
        raise ParameterError(f"max_edges is {max_edges}; it must be at least 3, or None for all holes")
    if outer not in ("keep", "fill"):
        raise ParameterError(f"outer is {outer!r}; it must be 'keep' or 'fill'")
    given, (mesh, exponent) = mesh, in_frame(without_lines(mesh))
    vertices, faces, scale = mesh.vertices, mesh.faces, _edge_length_around(mesh)
    beside = _faces_at_boundary(mesh)
    chords = np.empty((0, 2), np.int64)  # edges of patches between vertices that were there before
    holes = _sorted(mesh, max_edges, outer)
    for loop in holes.closed:
        taken = _edges_within(mesh, loop, chords)
        normals = mesh.face_normals[
            [beside[b, a] for a, b in zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True)]
        ]
        patch = loop[triangulate_loop(mesh.vertices[loop], normals, _places(loop, taken))]
        count = len(vertices)
        vertices, patch = refine(vertices, patch, scale, taken)
        scale = np.concatenate([scale, np.zeros(len(vertices) - count)])
        faces = np.concatenate([faces, patch])
        sides = np.stack([patch, np.roll(patch, -1, axis=1)], axis=2).reshape(-1, 2)
        chords = np.concatenate([chords, sides[(sides < len(mesh.vertices)).all(axis=1)]])
    patched = Mesh(vertices, faces)
    inside = np.arange(len(vertices)) >= len(mesh.vertices)
    patched = patched.moved(fair(patched, inside, order=1, weights="uniform", iterations=1))
    faired = fair(patched, inside, order=order, iterations=FAIRINGS)[inside]
    anchor = mesh.faces[0, 0]
    added = given.vertices[anchor] + np.ldexp(faired - mesh.vertices[anchor], exponent)
    whole = Mesh(np.concatenate([given.vertices, added]), np.concatenate([given.faces, faces[len(mesh.faces) :]]))
    return whole, holes


def _sorted(mesh: Mesh, max_edges: int | None, outer: Outer) -> Holes:
    """Return which of the boundary loops are closed, and which are kept."""
    loops = boundary_loops(mesh)
    outermost = _outer_boundaries(mesh, loops) if outer == "keep" else set()
    holes = Holes([], [], [])
    for number, loop in enumerate(loops):
        if number in outermost:
            holes.outer.append(loop)
        elif max_edges is not None and len(loop) > max_edges:
            holes.long.append(loop)
        else:
            holes.closed.append(loop)
    return holes


def _outer_boundaries(mesh: Mesh, loops: list[NDArray[np.int32]]) -> set[int]:
    """Return the numbers of the loops that are the outer boundary of an open component."""
    part = connected_components(mesh.topology.edges, len(mesh.vertices))
    areas = np.bincount(part[mesh.faces[:, 0]], mesh.areas, minlength=len(mesh.vertices))
    longest: dict[int, tuple[float, int]] = {}
    for number, loop in enumerate(loops):
        corners = np.mean([np.roll(mesh.vertices[loop], shift, axis=0) for shift in STRAIGHTENED], axis=0)
        length = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum())
        of_part = int(part[loop[0]])
        longest[of_part] = max(longest.get(of_part, (0.0, -1)), (length, number))
    return {number for of_part, (length, number) in longest.items() if length**2 > OUTER * areas[of_part]}


def boundary_loops(mesh: Mesh) -> list[NDArray[np.int32]]:
    """Return the vertices of each hole, once each, in the order in which faces that close it run along its boundary.

    A vertex at which holes touch is in each of their loops. Loops come in the order of their smallest edges.
    """
    single = mesh.topology.edge_faces.counts[mesh.topology.face_edges] == 1
    starts, ends = np.roll(mesh.faces, -1, axis=1)[single], mesh.faces[single]  # against the face
    onward: dict[int, list[int]] = {}
    for start, end in sorted(zip(starts.tolist(), ends.tolist(), strict=True), reverse=True):
        onward.setdefault(start, []).append(end)
    loops = []
    for start in sorted(onward):
        while onward[start]:
            path, place = [start], {start: 0}
            while onward.get(path[-1]):
                following = onward[path[-1]].pop()
                if following not in place:
                    place[following] = len(path)
                    path.append(following)
                    continue
                cut = place[following]
                loops.append(np.array(path[cut:], np.int32))
                for vertex in path[cut + 1 :]:
                    del place[vertex]
                del path[cut + 1 :]
    return [loop for loop in loops if len(loop) > 2]


def _faces_at_boundary(mesh: Mesh) -> dict[tuple[int, int], int]:
    """Face of each edge that has only one, by the edge's vertices in the order of the face."""
    single = mesh.topology.edge_faces.counts[mesh.topology.face_edges] == 1
    face, side = np.nonzero(single)
    first, second = mesh.faces[face, side], mesh.faces[face, (side + 1) % 3]
    return dict(zip(zip(first.tolist(), second.tolist(), strict=True), face.tolist(), strict=True))


def _edges_within(mesh: Mesh, loop: NDArray[np.int32], chords: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (e, 2) edges of the mesh, and the given ones, between vertices of a loop."""
    neighbors = mesh.topology.vertex_neighbors
    pairs = [(np.full(len(row), i), row) for i, row in ((i, neighbors.row(i)) for i in loop)]
    edges = np.concatenate([chords, *(np.stack(pair, axis=1) for pair in pairs)]).astype(np.int64)
    return np.asarray(edges[np.isin(edges, loop).all(axis=1)])


def _places(loop: NDArray[np.int32], edges: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (e, 2) where on a loop the ends of edges between its vertices are."""
    order = np.argsort(loop)
    return np.asarray(order[np.searchsorted(loop, edges, sorter=order)])


def _edge_length_around(mesh: Mesh) -> NDArray[np.float64]:
    """Return (n,) mean length of the edges of each vertex."""
    ends = mesh.vertices[mesh.topology.edges]
    lengths = np.repeat(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), 2)
    edges, n = mesh.topology.edges, len(mesh.vertices)
    return scatter_add(edges.ravel(), lengths.ravel(), n) / np.maximum(np.bincount(edges.ravel(), minlength=n), 1)
