"""Triangulate planar polygons with holes by ear clipping.

Edges can be flipped to the constrained Delaunay triangulation.
"""

import heapq
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.mesh import Floats

Triangles = NDArray[np.int64]

FLAT_AREA = 1e-9  # twice the area of a triangle, in squares of its longest side, below which it counts as flat


def triangulated(
    points: Floats, loops: Sequence[NDArray[np.int64]], *, inner: Iterable[int] = (), delaunay: bool = True
) -> Triangles:
    """Triangulate a polygon with holes by its own vertices and given inner ones.

    The loops index the points, (n, 2). The first is the outline, counterclockwise; the others are holes, clockwise.
    Edges are flipped until the triangulation is constrained Delaunay, or else the ears are kept as they were cut, in
    the order of the loops, with the fans and slivers that this produces. Returns (loop vertices + 2 holes - 2 + 2
    inner, 3) indices, counterclockwise. Raises UnfitShapeError if loops cross or touch, or a vertex is not inside.
    """
    order = list(loops[0])
    holes = sorted(loops[1:], key=lambda hole: -points[hole, 0].max())
    for position, hole in enumerate(holes):
        order = _bridged(points, order, hole, [*holes[position:]])
    triangles = _ears(points, order, best_first=delaunay)
    triangles = _split(points, triangles, list(inner))
    return _delaunay(points, triangles, loops) if delaunay else np.array(triangles, np.int64)


def _bridged(points: Floats, order: list[int], hole: NDArray[np.int64], left: list[NDArray[np.int64]]) -> list[int]:
    """Join a hole to the surrounding polygon along the shortest segment that crosses neither it nor other holes."""
    ring = np.array(order)
    first = np.concatenate([ring, *left])
    second = np.concatenate([np.roll(ring, -1), *[np.roll(loop, -1) for loop in left]])
    gaps = np.linalg.norm(points[ring][:, None] - points[hole][None], axis=2)
    for choice in np.argsort(gaps, axis=None, kind="stable"):
        i, k = divmod(int(choice), len(hole))
        a, b = ring[i], hole[k]
        inward = _in_corner(points, ring[i - 1], a, ring[(i + 1) % len(ring)], b)
        if inward and not _crosses(points, a, b, first, second):
            around = [*hole[k:], *hole[:k]]
            return [*order[: i + 1], *around, int(b), *order[i:]]
    raise UnfitShapeError("a hole cannot be reached from the outline")


def _turn(p: Floats, q: Floats, r: Floats) -> NDArray[np.float64]:
    """Return twice the signed area of triangles, over the last axis."""
    a, b = q - p, r - p
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _in_corner(points: Floats, before: int, at: int, after: int, to: int) -> bool:
    """Whether the segment from a vertex of the polygon to a point starts inside."""
    p, q, r, x = points[before], points[at], points[after], points[to]
    left, right = _turn(p, q, x) > 0, _turn(q, r, x) > 0
    return bool(left and right if _turn(p, q, r) > 0 else left or right)


def _crosses(points: Floats, a: int, b: int, first: NDArray[np.int64], second: NDArray[np.int64]) -> bool:
    """Whether the segment ab meets one of the edges that do not end in a or b."""
    others = (first != a) & (first != b) & (second != a) & (second != b)
    p, q = points[first[others]], points[second[others]]
    apart = _turn(p, q, points[a][None]) * _turn(p, q, points[b][None])
    beside = _turn(points[a], points[b], p) * _turn(points[a], points[b], q)
    return bool(((apart <= 0) & (beside <= 0)).any())


def _ears(points: Floats, order: list[int], *, best_first: bool) -> list[tuple[int, int, int]]:
    """Clip the ears of a simple polygon that passes each bridge twice, by quality or in order."""
    count = len(order)
    ring, corner = np.array(order), points[np.array(order)]
    before, after = np.arange(count) - 1, np.arange(count) + 1
    before[0], after[-1] = count - 1, 0
    alive, version = np.ones(count, bool), np.zeros(count, np.int64)
    waiting: list[tuple[float, int, int]] = []

    def offer(k: int) -> None:
        version[k] += 1
        quality = _ear_quality(corner, ring, alive, before[k], k, after[k])
        if quality > FLAT_AREA:
            heapq.heappush(waiting, (-quality if best_first else float(k + count * (version[k] > 1)), k, version[k]))

    for k in range(count):
        offer(k)
    triangles: list[tuple[int, int, int]] = []
    while len(triangles) < count - 2:
        if not waiting:
            raise UnfitShapeError("loops cross or touch")
        _, k, age = heapq.heappop(waiting)
        if not alive[k] or age != version[k]:
            continue
        p, q = before[k], after[k]
        if _ear_quality(corner, ring, alive, p, k, q) <= FLAT_AREA:
            continue
        triangles.append((int(ring[p]), int(ring[k]), int(ring[q])))
        alive[k] = False
        after[p], before[q] = q, p
        offer(p)
        offer(q)
    return triangles


def _ear_quality(corner: Floats, ring: NDArray[np.int64], alive: NDArray[np.bool_], p: int, k: int, q: int) -> float:
    """Return twice the area over the square of the longest side; 0 where the corner is not an ear."""
    a, b, c = corner[p], corner[k], corner[q]
    quality = float(_turn(a, b, c)) / max(((b - a) ** 2).sum(), ((c - b) ** 2).sum(), ((a - c) ** 2).sum(), 1e-300)
    if quality <= FLAT_AREA:
        return 0.0
    others = alive & (ring != ring[p]) & (ring != ring[k]) & (ring != ring[q])
    x = corner[others]
    inside = (_turn(a, b, x) >= 0) & (_turn(b, c, x) >= 0) & (_turn(c, a, x) >= 0)
    return 0.0 if inside.any() else quality


def _split(points: Floats, triangles: list[tuple[int, int, int]], inner: list[int]) -> list[tuple[int, int, int]]:
    """Split the triangle around each inner vertex into three."""
    faces = np.zeros((len(triangles) + 2 * len(inner), 3), np.int64)
    count = len(triangles)
    faces[:count] = triangles
    for v in inner:
        a, b, c = (points[faces[:count, k]] for k in range(3))
        inside = np.minimum(np.minimum(_turn(a, b, points[v]), _turn(b, c, points[v])), _turn(c, a, points[v]))
        f = int(inside.argmax())
        if inside[f] <= 0:
            raise UnfitShapeError("a vertex is not inside the polygon")
        p, q, r = faces[f]
        faces[f], faces[count], faces[count + 1] = (p, q, v), (q, r, v), (r, p, v)
        count += 2
    return [(int(p), int(q), int(r)) for p, q, r in faces]


def _delaunay(points: Floats, triangles: list[tuple[int, int, int]], loops: Sequence[NDArray[np.int64]]) -> Triangles:
    """Flip edges that are not on a loop while the circumcircle of a triangle contains the opposite corner (Lawson)."""
    faces = [list(triangle) for triangle in triangles]
    fixed = {frozenset(e) for loop in loops for e in zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True)}
    across: dict[tuple[int, int], int] = {}
    for f, (a, b, c) in enumerate(faces):
        across |= {(a, b): f, (b, c): f, (c, a): f}
    waiting = [edge for edge in across if edge[0] < edge[1]]
    flips = 0
    while waiting and flips < 20 * len(faces) ** 1.5:
        a, b = waiting.pop()
        if (a, b) not in across or (b, a) not in across or frozenset((a, b)) in fixed:
            continue
        f, g = across[a, b], across[b, a]
        c, d = sum(faces[f]) - a - b, sum(faces[g]) - a - b
        if not _in_circle(points[a], points[b], points[c], points[d]):
            continue
        flips += 1
        faces[f], faces[g] = [c, a, d], [d, b, c]
        del across[a, b], across[b, a]
        across |= {(a, d): f, (d, c): f, (c, a): f, (d, b): g, (b, c): g, (c, d): g}
        waiting += [(a, d), (d, b), (b, c), (c, a)]
    return np.array(faces, np.int64)


def _in_circle(a: Floats, b: Floats, c: Floats, d: Floats) -> bool:
    """Whether d, beyond the edge ab, is inside the circle through abc, and the other diagonal is inside both faces."""
    size = max(((a - b) ** 2).sum(), ((c - d) ** 2).sum())
    if min(_turn(c, a, d), _turn(d, b, c)) <= FLAT_AREA * size:
        return False
    at_c, at_d = np.dot(a - c, b - c), np.dot(a - d, b - d)
    sine_c, sine_d = _turn(c, a, b), _turn(d, b, a)
    return bool(sine_c * at_d + at_c * sine_d < -1e-12 * size**2)
