"""Shells: the closed surfaces around regions that share walls.

Walls meet at junction curves, which consist of edges with three or more faces. The faces around an edge are in cyclic
order, and the wedge between two consecutive faces belongs to a single region. Connecting the two face sides at each
wedge gives the shells of the regions.
"""

from collections import defaultdict
from typing import NamedTuple

import numpy as np

from cascadenorm.geometry.orientation import oriented_patches
from cascadenorm.mesh import Bools, Floats, Ints, Ints32, Mesh, Vectors, kernel, marked, repeats, scatter_add
from cascadenorm.mesh.vectors import cross, dot, length, row, subtract

Pattern = tuple[int, ...]
"""The walls around an edge in cyclic order: 2 w + 1 if the face of wall w traverses the edge forward, otherwise 2 w."""


class Shells(NamedTuple):
    """The shells of all regions as one mesh; each wall occurs twice, once per side, with separate vertices."""

    mesh: Mesh  # k vertices and q faces; each shell is oriented outward from its region
    owners: Ints  # (k,) wall vertex that each vertex is a copy of
    faces: Ints  # (q,) wall face that each face is a copy of
    flipped: Bools  # (q,) whether each face is oriented opposite to its wall face
    junctions: Ints32  # (j, 2) vertices of the junction edges, where three or more walls meet

    def of(self, mesh: Mesh) -> Mesh:
        """Return the shells with other positions of the wall vertices."""
        return self.mesh.moved(mesh.vertices[self.owners])

    def of_edges(self, mesh: Mesh, marked: Bools) -> Bools:
        """Return whether each edge of the shells is a copy of an edge of the walls that is marked in (e,) bool."""
        edges, count = mesh.topology.edges.astype(np.int64), len(mesh.vertices)
        copies = np.sort(self.owners[self.mesh.topology.edges], axis=1)
        places = np.searchsorted(edges[:, 0] * count + edges[:, 1], copies[:, 0] * count + copies[:, 1])
        return marked[places]

    def wall_normals(self, mesh: Mesh, normals: Vectors) -> Vectors:
        """Sum the normals of the shells, (q, 3), over the two sides of each wall face, (m, 3)."""
        signed = np.where(self.flipped[:, None], -normals, normals)
        return scatter_add(self.faces, signed, len(mesh.faces))


def split_into_shells(mesh: Mesh) -> tuple[Mesh, Shells | None]:
    """Return a mesh without duplicate faces on shared walls, and its `shells`; the mesh itself and None without any."""
    parts = shells(mesh)
    if parts is None:
        return mesh, None
    once = np.unique(parts.faces)
    if len(once) == len(mesh.faces):
        return mesh, parts
    mesh = Mesh(mesh.vertices, mesh.faces[once])
    return mesh, shells(mesh)


def shells(mesh: Mesh) -> Shells | None:
    """Return the shells of a mesh in which regions share walls; None if no component is divided.

    A component is divided into shells only if it has an edge where an odd number of walls separates three or more
    regions. Non-manifold edges of other components occur where bodies touch themselves or each other. On divided
    components, one of several faces on the same three vertices is kept. Each wall must be consistently oriented, as by
    `oriented`.
    """
    if (mesh.topology.edge_faces.counts < 3).all():
        return None
    distinct = ~repeats(np.sort(mesh.faces, axis=1))[0]
    counts = np.bincount(mesh.topology.face_edges[distinct].ravel(), minlength=len(mesh.topology.edges))
    junctions = np.flatnonzero(counts >= 3)
    if not len(junctions):
        return None
    wall = np.unique(oriented_patches(mesh).patch, return_inverse=True)[1]
    region, meets = _regions_at(mesh, junctions, wall, distinct)

    # Components to divide: those with such an edge
    component = mesh.topology.components
    divided = marked(component[mesh.topology.edges[junctions[meets], 0]], int(component.max()) + 1)
    inside = divided[mesh.topology.face_components]
    if not inside.any():
        return None
    edges = mesh.topology.edges[junctions]
    parts = _side_by_side(mesh, inside, distinct, region[2 * wall], region[2 * wall + 1])
    return Shells(*parts, edges[divided[component[edges[:, 0]]]])


def _regions_at(mesh: Mesh, junctions: Ints, wall: Ints, distinct: Bools) -> tuple[Ints, Bools]:
    """Return the region of each wall side, and whether an odd number of walls separates three regions at each junction.

    The front side of wall w is 2 w, the back side 2 w + 1.
    """
    pattern_of, votes = _patterns(mesh, junctions, wall, distinct)
    region, kinds = _regions(int(wall.max()) + 1, votes)
    separates = {p: len(p) % 2 == 1 and len({region[a] for a, _ in _wedges(p)}) >= 3 for p in kinds}
    return region, np.array([separates.get(pattern, False) for pattern in pattern_of])


def _side_by_side(
    mesh: Mesh, inside: Bools, distinct: Bools, ahead: Ints, behind: Ints
) -> tuple[Mesh, Ints, Ints, Bools]:
    """Copy faces for the regions in front of and behind them.

    Faces that are not inside, or have the same region on both sides, occur once.
    """
    count = np.int64(1 + max(ahead.max(), behind.max()))
    first = np.flatnonzero(~inside | distinct)
    second = np.flatnonzero(inside & distinct & (ahead != behind))
    faces = np.concatenate([first, second])
    flipped = np.arange(len(faces)) >= len(first)
    shell = np.concatenate([np.where(inside, behind, count)[first], ahead[second]])

    # One copy of a vertex for each of its shells, which are numbered by their lowest faces as seen from outside, since
    # the order and orientation of the faces must not affect the result
    corners = mesh.faces[faces].astype(np.int64)
    corners[flipped] = corners[flipped, ::-1]
    least = corners.min(axis=1)
    lowest = np.full(count + 1, len(mesh.vertices))
    np.minimum.at(lowest, shell, least)
    low = np.flatnonzero(least == lowest[shell])
    turns = corners[low].argmin(axis=1)[:, None] + np.arange(3)
    low = low[np.lexsort(np.take_along_axis(corners[low], turns % 3, axis=1).T[::-1])]
    numbers, places = np.unique(shell[low], return_index=True)
    rank = np.zeros(count + 1, np.int64)
    rank[numbers[np.argsort(places)]] = np.arange(len(numbers))
    copies, corners = np.unique(corners * (count + 1) + rank[shell][:, None], return_inverse=True)
    corners = corners.reshape(-1, 3)
    owners = copies // (count + 1)
    return Mesh(mesh.vertices[owners], corners), owners, faces, flipped


def _patterns(mesh: Mesh, junctions: Ints, wall: Ints, distinct: Bools) -> tuple[list[Pattern], dict[Pattern, float]]:
    """Return the pattern of the walls at each junction edge, and the votes for each pattern.

    The votes are the sum, over all edges with the pattern, of the smallest angle between consecutive walls.
    """
    around = mesh.topology.edge_faces
    found, votes = list[Pattern](), defaultdict[Pattern, float](float)
    for edge in junctions:
        faces = around.row(edge)
        faces = faces[distinct[faces]]
        order, runs, narrowest = _sorted_around_edge(mesh.vertices, mesh.faces, faces, *mesh.topology.edges[edge])
        pattern = _canonical(tuple((2 * wall[faces[order]] + runs[order]).tolist()))
        found.append(pattern)
        votes[pattern] += narrowest
    return found, votes


def _regions(walls: int, votes: dict[Pattern, float]) -> tuple[Ints, set[Pattern]]:
    """Join the wall sides that share a wedge into regions.

    Noise changes the order of walls around some edges. Patterns are therefore applied in the order of their votes, and
    a pattern that would join the two sides of a wall is skipped, since walls separate regions. Returns the (2 walls,)
    region of each side, and the patterns that were applied.
    """
    region = np.arange(2 * walls)
    sides = [[side] for side in range(2 * walls)]  # sides of each region
    followed = set()
    for pattern in sorted(votes, key=lambda p: (-votes[p], p)):
        if any(region[other] in region[np.array(sides[region[one]]) ^ 1] for one, other in _wedges(pattern)):
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
    """Return the lexicographically least form of a pattern, over all rotations and both directions of the edge."""
    against = tuple(token ^ 1 for token in reversed(pattern))
    return min(_least_rotation(pattern), _least_rotation(against))


def _least_rotation(pattern: Pattern) -> Pattern:
    """Return the lexicographically least rotation of a pattern in linear time, with two competing start positions."""
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
    """Return the pairs of wall sides at each wedge of a pattern."""
    following = pattern[1:] + pattern[:1]
    return [(one ^ 1, other) for one, other in zip(pattern, following, strict=True)]


@kernel
def _sorted_around_edge(vertices: Floats, faces: Ints32, around: Ints32, a: int, b: int) -> tuple[Ints, Ints, float]:
    """Sort the faces at an edge by angle, counterclockwise when viewed against the direction from a to b.

    Returns the (k,) order of the faces; (k,) 1 if a face traverses the edge from a to b, else 0; and the smallest angle
    between consecutive faces.
    """
    # The direction of each face perpendicular to the edge; angles are measured from the first
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

    # The angles between consecutive faces, cyclically
    order = np.argsort(angles)
    narrowest = angles[order[0]] + 2 * np.pi - angles[order[-1]]
    for k in range(1, len(order)):
        narrowest = min(narrowest, angles[order[k]] - angles[order[k - 1]])
    return order, runs, narrowest
