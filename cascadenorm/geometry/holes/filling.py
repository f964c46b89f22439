"""Hole filling: boundary loops, triangulation, refinement and fairing (Liepa 2003)."""

import math
from typing import Literal, NamedTuple

import numpy as np

from cascadenorm.errors import ParameterError
from cascadenorm.geometry.fairing import fair
from cascadenorm.geometry.holes.refinement import refine
from cascadenorm.geometry.holes.triangulation import triangulate_loop
from cascadenorm.geometry.laplacians import Order
from cascadenorm.mesh import (
    Floats,
    Ints,
    Ints32,
    Mesh,
    connected_components,
    in_frame,
    scatter_add,
    surface_of,
)
from cascadenorm.registry import checked_number

FAIRINGS = 5  # solves with an updated Laplacian, starting from a membrane

# It is 2π for a hemisphere, 4π for a disk, and much smaller for a sphere with a small hole.
OUTER = 2 * math.pi  # ratio of squared boundary length to component area above which a boundary is an outer one

STRAIGHTENED = 2  # reach of the window that smooths a loop before its length is measured, against zigzags
LEAST_PER_REACH = 12  # least number of edges per reach; wider windows would shorten a loop by over a tenth

Outer = Literal["keep", "fill"]


class Holes(NamedTuple):
    """The boundary loops of a mesh, each as an array of vertices."""

    closed: list[Ints32]  # those that are filled
    outer: list[Ints32]  # outer boundaries of open components, which are kept
    long: list[Ints32]  # others with too many edges, which are kept


def fill_holes(mesh: Mesh, *, order: Order = 2, max_edges: int | None = None, outer: Outer = "keep") -> Mesh:
    """Fill the holes of a mesh with patches of the same density as the surrounding mesh.

    Existing vertices and faces keep their positions and indices; new ones are appended.

    Parameters
    ----------
    mesh
        Mesh with holes. Chains of boundary edges that do not form a loop, as between faces of opposite orientation, are
        left open, and so are single faces that are joined to others by a vertex at most.
    order
        1 for a membrane, 2 for a thin plate, which continues the tangents, 3 for minimum variation, which continues the
        curvature.
    max_edges
        Largest number of edges of a hole that is filled; None fills all holes.
    outer
        "keep" preserves the outer boundary of an open surface, such as a scan from one side: the longest boundary of a
        component, if it is longer than that of a hemisphere of the same area. "fill" fills it like a hole.

    Returns
    -------
    The mesh with the added vertices and faces.

    Raises
    ------
    ParameterError
        `order` is not 1, 2 or 3, `max_edges` is below 3, or `outer` is invalid.
    """
    return filled(mesh, order=order, max_edges=max_edges, outer=outer)[0]


def filled(mesh: Mesh, *, order: Order, max_edges: int | None, outer: Outer) -> tuple[Mesh, Holes]:
    """Fill the holes of a mesh as `fill_holes` does, and also return the filled and kept loops."""
    if order not in (1, 2, 3):
        raise ParameterError(f"order is {order!r}; it must be 1, 2 or 3")
    max_edges = checked_number("max_edges", int | None, max_edges, minimum=3)
    if outer not in ("keep", "fill"):
        raise ParameterError(f"outer is {outer!r}; it must be 'keep' or 'fill'")
    given, (mesh, exponent) = mesh, in_frame(surface_of(mesh))
    vertices, faces, scale = mesh.vertices, mesh.faces, _edge_length_around(mesh)
    beside = _faces_at_boundary(mesh)
    chords = np.empty((0, 2), np.int64)  # edges of patches between original vertices
    holes = _sorted(mesh, beside, max_edges, outer)
    for loop in holes.closed:
        taken = _edges_within(mesh, loop, chords)
        normals = mesh.face_normals[[beside[side] for side in _sides(loop)]]
        patch = loop[triangulate_loop(mesh.vertices[loop], normals, _places(loop, taken))]
        count = len(vertices)
        vertices, patch = refine(vertices, patch, scale, taken)
        scale = np.concatenate([scale, np.zeros(len(vertices) - count)])
        faces = np.concatenate([faces, patch])
        edges = np.stack([patch, np.roll(patch, -1, axis=1)], axis=2).reshape(-1, 2)
        chords = np.concatenate([chords, edges[(edges < len(mesh.vertices)).all(axis=1)]])
    patched = Mesh(vertices, faces)
    inside = np.arange(len(vertices)) >= len(mesh.vertices)
    patched = patched.moved(fair(patched, inside, order=1, weights="uniform", iterations=1))
    faired = fair(patched, inside, order=order, iterations=FAIRINGS)[inside]
    anchor = mesh.faces[0, 0]
    added = given.vertices[anchor] + np.ldexp(faired - mesh.vertices[anchor], exponent)
    whole = Mesh(np.concatenate([given.vertices, added]), np.concatenate([given.faces, faces[len(mesh.faces) :]]))
    return whole, holes


def _sorted(mesh: Mesh, beside: dict[tuple[int, int], int], max_edges: int | None, outer: Outer) -> Holes:
    """Sort the boundary loops into those to fill and those to keep; a loop around a single face is neither."""
    loops = boundary_loops(mesh)
    outermost = _outer_boundaries(mesh, loops, beside) if outer == "keep" else set()
    holes = Holes([], [], [])
    for number, loop in enumerate(loops):
        if number in outermost:
            holes.outer.append(loop)
        elif max_edges is not None and len(loop) > max_edges:
            holes.long.append(loop)
        elif len({beside[side] for side in _sides(loop)}) > 1:  # else it would be filled with the reverse of the face
            holes.closed.append(loop)
    return holes


def _outer_boundaries(mesh: Mesh, loops: list[Ints32], beside: dict[tuple[int, int], int]) -> set[int]:
    """Return the indices of the loops that are the outer boundary of an open component, whose faces share edges."""
    count, edges = len(mesh.faces), mesh.topology.face_edges
    links = np.stack([np.repeat(np.arange(count), 3), count + edges.ravel()], axis=1)
    part = connected_components(links, count + len(mesh.topology.edges))
    areas = np.bincount(part[:count], mesh.areas)
    longest: dict[int, tuple[float, int]] = {}
    for number, loop in enumerate(loops):
        reach = min(STRAIGHTENED, len(loop) // LEAST_PER_REACH)
        window = range(-reach, reach + 1)
        corners = np.mean([np.roll(mesh.vertices[loop], shift, axis=0) for shift in window], axis=0)
        length = float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).sum())
        of_part = int(part[beside[_sides(loop)[0]]])
        longest[of_part] = max(longest.get(of_part, (0.0, -1)), (length, number))
    return {number for of_part, (length, number) in longest.items() if length**2 >= OUTER * areas[of_part]}


def boundary_loops(mesh: Mesh) -> list[Ints32]:
    """Return the vertices of each boundary loop, in the direction of the faces that would fill it.

    A vertex where holes touch belongs to each of their loops, once per loop. Loops are ordered by their lowest edges.
    """
    onward: dict[int, list[int]] = {}
    for start, end in sorted((edge[::-1] for edge in _faces_at_boundary(mesh)), reverse=True):  # opposite to the faces
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


def _sides(loop: Ints32) -> list[tuple[int, int]]:
    """Return the edges of a loop in the direction of the faces beside it."""
    return list(zip(np.roll(loop, -1).tolist(), loop.tolist(), strict=True))


def _faces_at_boundary(mesh: Mesh) -> dict[tuple[int, int], int]:
    """Return the face of each boundary edge, by the edge's vertices in the order of the face."""
    single = mesh.topology.edge_faces.counts[mesh.topology.face_edges] == 1
    face, side = np.nonzero(single)
    first, second = mesh.faces[face, side], mesh.faces[face, (side + 1) % 3]
    return dict(zip(zip(first.tolist(), second.tolist(), strict=True), face.tolist(), strict=True))


def _edges_within(mesh: Mesh, loop: Ints32, chords: Ints) -> Ints:
    """Return the (e, 2) edges between vertices of a loop, among those of the mesh and the given chords."""
    neighbors = mesh.topology.vertex_neighbors
    pairs = [(np.full(len(row), i), row) for i, row in ((i, neighbors.row(i)) for i in loop)]
    edges = np.concatenate([chords, *(np.stack(pair, axis=1) for pair in pairs)]).astype(np.int64)
    return np.asarray(edges[np.isin(edges, loop).all(axis=1)])


def _places(loop: Ints32, edges: Ints) -> Ints:
    """Return the (e, 2) positions along a loop of the ends of edges between its vertices."""
    order = np.argsort(loop)
    return np.asarray(order[np.searchsorted(loop, edges, sorter=order)])


def _edge_length_around(mesh: Mesh) -> Floats:
    """Return the (n,) mean edge length at each vertex."""
    ends, n = mesh.topology.edges.ravel(), len(mesh.vertices)
    along = mesh.vertices[ends[1::2]] - mesh.vertices[ends[::2]]
    lengths = np.repeat(np.linalg.norm(along, axis=1), 2)
    return scatter_add(ends, lengths, n) / np.maximum(np.bincount(ends, minlength=n), 1)
