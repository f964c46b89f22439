"""Regions that share walls, told from the walls alone: the closed surface, or shell, around each region.

Walls meet at junction curves, edges of three faces or more. Each face has two sides. Around an edge the faces lie in
cyclic order, and between one and the next is a wedge of some region, which joins their sides that look into it. What
is joined is the shell of a region.
"""

from collections import defaultdict
from typing import NamedTuple

import numpy as np

from cascadenorm.geometry.orientation import oriented_patches
from cascadenorm.mesh import Bools, Floats, Ints, Ints32, Mesh, Vectors, kernel, scatter_add
from cascadenorm.mesh.vectors import cross, dot, length, row, subtract

Pattern = tuple[int, ...]
"""The walls around an edge in cyclic order: 2 w + 1 where a face of wall w runs along it, 2 w where against it."""


class Shells(NamedTuple):
    """The shells of regions side by side: a wall twice, once for each of its sides, with vertices of their own.

    Parameters
    ----------
    mesh
        k vertices and q faces, each shell oriented outward of its region.
    owners
        (k,) the vertex of the walls that each is a copy of.
    faces
        (q,) the face of the walls that each is a copy of.
    flipped
        (q,) whether it is oriented against that face.
    junctions
        (j, 2) vertices of the edges of the walls where three or more meet.
    """

    mesh: Mesh
    owners: Ints
    faces: Ints
    flipped: Bools
    junctions: Ints32

    def of(self, mesh: Mesh) -> Mesh:
        """Return the shells with other positions of the vertices of the walls."""
        return self.mesh.moved(mesh.vertices[self.owners])

    def of_edges(self, mesh: Mesh, marked: Bools) -> Bools:
        """Return which edges of the shells are copies of marked edges of the walls, (e,) over those of `mesh`."""
        edges, count = mesh.topology.edges.astype(np.int64), len(mesh.vertices)
        copies = np.sort(self.owners[self.mesh.topology.edges], axis=1)
        places = np.searchsorted(edges[:, 0] * count + edges[:, 1], copies[:, 0] * count + copies[:, 1])
        return marked[places]

    def wall_normals(self, mesh: Mesh, normals: Vectors) -> Vectors:
        """Average what the two sides of each face of the walls have, (q, 3), to (m, 3)."""
        signed = np.where(self.flipped[:, None], -normals, normals)
        return scatter_add(self.faces, signed, len(mesh.faces))


def into_shells(mesh: Mesh) -> tuple[Mesh, Shells | None]:
    """Return a mesh, without the second of faces on the same three vertices where regions share walls, and its shells.

    See `shells`; a mesh whose regions share no walls is returned as it is.
    """
    parts = shells(mesh)
    if parts is None:
        return mesh, None
    once = np.unique(parts.faces)
    if len(once) == len(mesh.faces):
        return mesh, parts
    mesh = Mesh(mesh.vertices, mesh.faces[once])
    return mesh, shells(mesh)


def shells(mesh: Mesh) -> Shells | None:
    """Return the shells of a mesh whose regions share walls.

    Components without an edge where an odd number of walls separates three regions or more stay as they are: such
    edges are those of bodies that touch themselves or others. Of faces on the same three vertices one is kept.

    Parameters
    ----------
    mesh
        m faces, consistently oriented on each wall, as `oriented` leaves them.

    Returns
    -------
    None if no component has such an edge
    """
    if (mesh.topology.edge_faces.counts < 3).all():
        return None
    distinct = _first_of_twins(mesh.faces)
    junctions = _junctions(mesh, distinct)
    if not len(junctions):
        return None
    wall = np.unique(oriented_patches(mesh).patch, return_inverse=True)[1]
    region, meets = _regions_at(mesh, junctions, wall, distinct)

    # Components with such an edge
    component = mesh.topology.components
    divided = np.zeros(component.max() + 1, bool)
    divided[component[mesh.topology.edges[junctions[meets], 0]]] = True
    inside = divided[mesh.topology.face_components]
    if not inside.any():
        return None
    edges = mesh.topology.edges[junctions]
    parts = _side_by_side(mesh, inside, distinct, region[2 * wall], region[2 * wall + 1])
    return Shells(*parts, edges[divided[component[edges[:, 0]]]])


def _junctions(mesh: Mesh, distinct: Bools) -> Ints:
    """Return the edges at which three faces or more meet, those on the same three vertices counted once."""
    counts = np.bincount(mesh.topology.face_edges[distinct].ravel(), minlength=len(mesh.topology.edges))
    return np.flatnonzero(counts >= 3)


def _regions_at(mesh: Mesh, junctions: Ints, wall: Ints, distinct: Bools) -> tuple[Ints, Bools]:
    """Return the region of each side of the walls, and at which junctions an odd number of walls separates three.

    The side ahead of wall w is 2 w, that behind it 2 w + 1.
    """
    pattern_of, votes = _patterns(mesh, junctions, wall, distinct)
    region, kinds = _regions(int(wall.max()) + 1, votes)
    separates = {p: len(p) % 2 == 1 and len({region[a] for a, _ in _wedges(p)}) >= 3 for p in kinds}
    return region, np.array([separates.get(pattern, False) for pattern in pattern_of])


def _side_by_side(
    mesh: Mesh,
    inside: Bools,
    distinct: Bools,
    ahead: Ints,
    behind: Ints,
) -> tuple[Mesh, Ints, Ints, Bools]:
    """Copy faces for the regions ahead of and behind them; those not inside, or between a region and itself, once."""
    count = np.int64(1 + max(ahead.max(), behind.max()))
    first = np.flatnonzero(~inside | distinct)
    second = np.flatnonzero(inside & distinct & (ahead != behind))
    faces = np.concatenate([first, second])
    flipped = np.arange(len(faces)) >= len(first)
    shell = np.concatenate([np.where(inside, behind, count)[first], ahead[second]])

    # A copy of a vertex for each shell that it belongs to
    keys = mesh.faces[faces].astype(np.int64) * (count + 1) + shell[:, None]
    copies, corners = np.unique(keys, return_inverse=True)
    corners = corners.reshape(-1, 3)
    corners[flipped] = corners[flipped, ::-1]
    owners = copies // (count + 1)
    return Mesh(mesh.vertices[owners], corners), owners, faces, flipped


def _first_of_twins(faces: Ints32) -> Bools:
    """Return (m,) which faces are the first on their three vertices."""
    _, first = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    distinct = np.zeros(len(faces), bool)
    distinct[first] = True
    return distinct


def _patterns(mesh: Mesh, junctions: Ints, wall: Ints, distinct: Bools) -> tuple[list[Pattern], dict[Pattern, float]]:
    """Return the pattern of the walls at each junction edge, and of each pattern the angle that speaks for it.

    That is the sum, over the edges that have it, of the narrowest angle between two of their walls.
    """
    around = mesh.topology.edge_faces
    found, votes = list[Pattern](), defaultdict[Pattern, float](float)
    for edge in junctions:
        faces = around.row(edge)
        faces = faces[distinct[faces]]
        order, runs, narrowest = _around(mesh.vertices, mesh.faces, faces, *mesh.topology.edges[edge])
        pattern = _canonical(tuple((2 * wall[faces[order]] + runs[order]).tolist()))
        found.append(pattern)
        votes[pattern] += narrowest
    return found, votes


def _regions(walls: int, votes: dict[Pattern, float]) -> tuple[Ints, set[Pattern]]:
    """Join the sides of walls that look into one wedge.

    Noise changes the order of walls around some edges. So the patterns with most votes come first, and one that would
    join the two sides of a wall, which separates regions, is left out.

    Returns
    -------
    (2 walls,) the region of each side, and the patterns that were followed
    """
    region = np.arange(2 * walls)
    sides = [[side] for side in range(2 * walls)]  # of each region
    followed = set()
    for pattern in sorted(votes, key=lambda p: (-votes[p], p)):
        wedges = [tuple(region[[one, other]].tolist()) for one, other in _wedges(pattern)]
        if any(not set(region[np.array(sides[one]) ^ 1].tolist()).isdisjoint([other]) for one, other in wedges):
            continue
        followed.add(pattern)
        for one, other in _wedges(pattern):
            kept, joined = sorted((int(region[one]), int(region[other])), key=lambda r: -len(sides[r]))
            if kept != joined:
                region[sides[joined]] = kept
                sides[kept] += sides[joined]
                sides[joined] = []
    return region, followed


def _canonical(pattern: Pattern) -> Pattern:
    """Return the least form of a pattern, among those seen along and against the edge and begun at any face."""
    against = tuple(token ^ 1 for token in reversed(pattern))
    return min(_least_rotation(pattern), _least_rotation(against))


def _least_rotation(pattern: Pattern) -> Pattern:
    """Return the least form of a pattern begun at any place, in linear time: the worse of two places skips ahead."""
    one, other, same, count = 0, 1, 0, len(pattern)
    while max(one, other, same) < count:
        first, second = pattern[(one + same) % count], pattern[(other + same) % count]
        if first == second:
            same += 1
            continue
        if first > second:
            one += same + 1
        else:
            other += same + 1
        other += one == other
        same = 0
    start = min(one, other)
    return pattern[start:] + pattern[:start]


def _wedges(pattern: Pattern) -> list[tuple[int, int]]:
    """Return the pairs of sides of walls that look into each wedge of a pattern."""
    following = pattern[1:] + pattern[:1]
    return [(one ^ 1, other) for one, other in zip(pattern, following, strict=True)]


@kernel
def _around(vertices: Floats, faces: Ints32, around: Ints32, a: int, b: int) -> tuple[Ints, Ints, float]:
    """Order the faces at an edge by their angle about it, counterclockwise seen against the direction from a to b.

    Returns
    -------
    (k,) the order; (k,) 1 where a face runs from a to b, else 0; the narrowest angle between one and the next
    """
    # The direction of each face across the edge; angles are measured from the first
    angles, runs = np.zeros(len(around)), np.zeros(len(around), np.int64)
    edge = subtract(row(vertices, b), row(vertices, a))
    size = length(edge)
    first = second = (0.0, 0.0, 0.0)
    for k in range(len(around)):
        u, v, w = faces[around[k]]
        apex = u if u not in (a, b) else (v if v not in (a, b) else w)
        runs[k] = (u == a and v == b) or (v == a and w == b) or (w == a and u == b)
        across = cross(cross(edge, subtract(row(vertices, apex), row(vertices, a))), edge)
        if k == 0:
            first, second = across, cross(edge, across)
        angles[k] = np.arctan2(dot(across, second), dot(across, first) * size) % (2 * np.pi)

    # The gaps between one and the next, around
    order = np.argsort(angles)
    narrowest = angles[order[0]] + 2 * np.pi - angles[order[-1]]
    for k in range(1, len(order)):
        narrowest = min(narrowest, angles[order[k]] - angles[order[k - 1]])
    return order, runs, narrowest
