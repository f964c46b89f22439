"""Triangulation of closed loops in space (Liepa 2003; Barequet & Sharir 1995)."""

import heapq

import numpy as np

from cascadenorm.mesh import Bools, Floats, Ints, Ints32, Vectors, kernel
from cascadenorm.mesh.vectors import cross, length, row, subtract

LARGEST_OPTIMAL = 300  # vertices of a loop; the optimal triangulation takes cubic time


def triangulate_loop(points: Vectors, outside: Vectors, taken: Ints) -> Ints32:
    """Triangulate a loop with the smallest maximum dihedral angle, then the smallest area; return (n - 2, 3) points.

    The points, (n, 3), are in the direction of the triangles along the loop. `outside` holds the (n, 3) unit normals of
    the faces across the edges from point k to k + 1. The (e, 2) pairs of points that are `taken`, joined by an edge
    elsewhere, are avoided if possible. Loops with more than 300 vertices are triangulated by ear clipping, shortest new
    edge first.
    """
    n = len(points)
    if n > LARGEST_OPTIMAL:
        return _cut_ears(points, taken)
    choice, joined = np.zeros((n, n), np.int32), np.zeros((n, n), bool)
    joined[taken[:, 0], taken[:, 1]] = joined[taken[:, 1], taken[:, 0]] = True
    _least_bend(np.ascontiguousarray(points), outside, joined, choice)
    triangles, spans = [], [(0, n - 1)]
    while spans:
        i, k = spans.pop()
        if k - i > 1:
            m = int(choice[i, k])
            triangles.append((i, m, k))
            spans += [(i, m), (m, k)]
    return np.array(triangles, np.int32)


def _cut_ears(points: Vectors, taken: Ints) -> Ints32:
    n, joined = len(points), set(map(tuple, np.sort(taken, axis=1).tolist()))
    before, after = np.roll(np.arange(n), 1), np.roll(np.arange(n), -1)

    def cost(i: int) -> tuple[bool, float, int, int, int]:
        a, b = int(before[i]), int(after[i])
        return (min(a, b), max(a, b)) in joined, float(np.linalg.norm(points[b] - points[a])), a, i, b

    queue = [cost(i) for i in range(n)]
    heapq.heapify(queue)
    triangles: list[tuple[int, int, int]] = []
    while len(triangles) < n - 2:
        _, _, a, i, b = heapq.heappop(queue)
        if before[i] != a or after[i] != b:
            continue  # outdated: a neighbouring ear was cut
        triangles.append((a, i, b))
        after[a], before[b] = b, a
        before[i] = after[i] = -1
        heapq.heappush(queue, cost(a))
        heapq.heappush(queue, cost(b))
    return np.array(triangles, np.int32)


@kernel
def _normal(points: Vectors, i: int, m: int, k: int, normal: Floats) -> float:
    """Write the unit normal of a triangle, or zero if it has no area, and return the area."""
    u, v = subtract(row(points, m), row(points, i)), subtract(row(points, k), row(points, i))
    normal[0], normal[1], normal[2] = cross(u, v)
    size = length(cross(u, v))
    if size > 0:
        normal /= size
    return 0.5 * size


@kernel
def _least_bend(points: Vectors, outside: Vectors, taken: Bools, choice: Ints32) -> None:
    """Fill choice[i, k]: the third corner at the chord i k in the best triangulation of the points i … k.

    The bend is the largest 1 - cos of the angle across an edge; a taken chord counts as worse than any bend.
    """
    n = len(points)
    bend, area = np.zeros((n, n)), np.zeros((n, n))
    normal, beside = np.empty(3), np.empty(3)
    # dynamic programming (Barequet, Sharir 1995): chords by increasing span, each from two shorter ones
    for gap in range(2, n):
        for i in range(n - gap):
            k = i + gap
            bend[i, k], area[i, k] = np.inf, np.inf
            for m in range(i + 1, k):
                total = area[i, m] + area[m, k] + _normal(points, i, m, k, normal)
                worst = max(bend[i, m], bend[m, k])
                # bends across the two other sides: to the triangle across a chord, or to the face around the hole
                for a, b in ((i, m), (m, k)):
                    if b == a + 1:
                        beside[:] = outside[a]
                    else:
                        _normal(points, a, choice[a, b], b, beside)
                    worst = max(worst, 1.0 - (normal * beside).sum())
                # the last chord closes the loop and has a face across it; edges that exist elsewhere are avoided
                if gap == n - 1:
                    worst = max(worst, 1.0 - (normal * outside[k]).sum())
                elif taken[i, k]:
                    worst = max(worst, 3.0)
                if worst < bend[i, k] or (worst == bend[i, k] and total < area[i, k]):
                    bend[i, k], area[i, k], choice[i, k] = worst, total, m
