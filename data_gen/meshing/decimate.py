"""Decimate a mesh by the edge collapses with the least quadric error.

Curved regions keep many triangles, flat ones few.
"""

import numpy as np

from cascadenorm.data_gen.meshing.half_edges import (
    CORNER,
    RING,
    HalfEdges,
    after,
    collapse,
    collapse_keeps_manifold,
    distance,
    doubled_area_vector,
    mesh_of,
)
from cascadenorm.data_gen.meshing.remesh import editable, faces_survive
from cascadenorm.data_gen.meshing.surface import fit
from cascadenorm.mesh import Floats, Mesh, kernel
from cascadenorm.mesh.vectors import length


def thinned(mesh: Mesh, *, faces: int, evenness: float) -> Mesh:
    """Return a mesh decimated to about `faces` faces; see `decimate`. Raises UnfitShapeError if it is invalid."""
    half_edges = editable(mesh, faces=faces)
    decimate(half_edges, faces=faces, evenness=evenness)
    return fit(mesh_of(half_edges))


def decimate(half_edges: HalfEdges, *, faces: int, evenness: float) -> None:
    """Collapse edges until about `faces` faces are left, the cheapest first.

    The cost of a collapse is the quadric error of the merged vertex (Garland and Heckbert 1997), plus `evenness` times
    the squared edge length times the surrounding area, so that flat regions keep triangles.
    """
    quadrics = _quadrics(half_edges)
    share = 0.1
    for _ in range(40):
        left = int((half_edges.origin[: 3 * half_edges.used[1] : 3] >= 0).sum())
        if left <= 1.02 * faces:
            return
        costs = _costs(half_edges, quadrics, evenness)
        bound = np.quantile(costs[costs < np.inf], min(share, 0.5 * (left - faces) / left + 0.01))
        if _collapse_cheap(half_edges, quadrics, evenness, bound, left - faces) == 0:
            share = min(2 * share, 1.0)


@kernel
def _quadrics(c: HalfEdges) -> Floats:
    """Sum area · (n, d)(n, d)ᵀ, ten numbers, and the area over the faces around each vertex."""
    quadrics = np.zeros((len(c.points), 11))
    for face in range(c.used[1]):
        h = 3 * face
        if c.origin[h] == -1:
            continue
        p = c.points[c.origin[h]]
        x, y, z = doubled_area_vector(p, c.points[c.origin[h + 1]], c.points[c.origin[h + 2]])
        size = length((x, y, z))
        if size == 0.0:
            continue
        plane = np.array([x / size, y / size, z / size, -(x * p[0] + y * p[1] + z * p[2]) / size])
        for k in range(h, h + 3):
            entry = 0
            for i in range(4):
                for j in range(i, 4):
                    quadrics[c.origin[k], entry] += size * plane[i] * plane[j]
                    entry += 1
            quadrics[c.origin[k], 10] += size
    return quadrics


@kernel
def _miss(q: Floats, r: Floats, p: Floats) -> float:
    """Evaluate the sum of two quadrics at a point."""
    x, y, z = p[0], p[1], p[2]
    total: float = (q[0] + r[0]) * x * x + (q[4] + r[4]) * y * y + (q[7] + r[7]) * z * z + q[9] + r[9]
    total += 2 * ((q[1] + r[1]) * x * y + (q[2] + r[2]) * x * z + (q[5] + r[5]) * y * z)
    total += 2 * ((q[3] + r[3]) * x + (q[6] + r[6]) * y + (q[8] + r[8]) * z)
    return max(total, 0.0)


@kernel
def _best(c: HalfEdges, quadrics: Floats, evenness: float, h: int) -> tuple[float, float]:
    """Return the cheapest position of the merged vertex, as a share of the way along h, and its cost."""
    a, b = c.origin[h], c.origin[after(h)]
    best, cost = 1.0, np.inf
    for share in (0.0, 0.5, 1.0):
        if share < 1.0 and c.kind[b] == CORNER:
            continue
        miss = _miss(quadrics[a], quadrics[b], c.points[a] + share * (c.points[b] - c.points[a]))
        if miss < cost:
            best, cost = share, miss
    area = quadrics[a, 10] + quadrics[b, 10]
    return best, cost + evenness * area * distance(c.points[a], c.points[b]) ** 2


@kernel
def _costs(c: HalfEdges, quadrics: Floats, evenness: float) -> Floats:
    costs = np.full(3 * c.used[1], np.inf)
    for h in range(len(costs)):
        if c.origin[h] != -1 and c.twin[h] > h:
            costs[h] = _best(c, quadrics, evenness, h)[1]
    return costs


@kernel
def _collapse_cheap(c: HalfEdges, quadrics: Floats, evenness: float, bound: float, surplus: int) -> int:
    ring, other = np.empty(RING, np.int64), np.empty(RING, np.int64)
    done = 0
    for start in range(3 * c.used[1]):
        h = start
        if 2 * done >= surplus:
            break
        if c.origin[h] == -1 or c.twin[h] < h:
            continue
        # The removed vertex must not be a corner.
        if c.kind[c.origin[h]] == CORNER:
            h = c.twin[h]
        a, b = c.origin[h], c.origin[after(h)]
        if c.kind[a] == CORNER:
            continue
        share, cost = _best(c, quadrics, evenness, h)
        if cost > bound or not collapse_keeps_manifold(c, h, ring, other):
            continue
        # Collapse if no surrounding face flips or becomes too long. The quadrics of the two vertices add up.
        place = c.points[a] + share * (c.points[b] - c.points[a])
        longest = 4 * c.length[a]
        if faces_survive(c, a, b, place, longest, ring) and faces_survive(c, b, a, place, longest, ring):
            collapse(c, h, ring)
            c.points[b] = place
            quadrics[b] += quadrics[a]
            done += 1
    return done
