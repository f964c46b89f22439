"""Triangulation of polygons by ear clipping."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Bools, Floats, Ints, kernel

MOST_CORNERS = 20_000
"""Largest number of corners of a polygon that is triangulated; the time grows quadratically."""
MOST_PASSES = 16  # over all corners, needed where rounding errors hide ears; one is nearly always enough


def ears(corners: NDArray[Any]) -> NDArray[np.int64] | None:
    """Triangulate a polygon by ear clipping, projected along its mean normal.

    An ear is a convex corner with no other corner in its triangle. The corners, (c, 3), are in order. Returns (c - 2,
    3) indices of corners; None if the polygon intersects itself, is not finite or has too many corners.
    """
    if len(corners) > MOST_CORNERS:
        return None
    with np.errstate(all="ignore"):
        near_one = (corners - corners[0]) / np.float64(np.abs(corners - corners[0]).max() or 1)
        normal = np.cross(near_one, np.roll(near_one, -1, axis=0)).sum(axis=0)
        if not np.isfinite(normal).all():
            return None
        x, y = np.ascontiguousarray((near_one @ np.linalg.svd(normal[None])[2][1:].T).T)
    if np.roll(y, -1) @ x - np.roll(x, -1) @ y < 0:
        y = -y
    out = np.empty((len(corners) - 2, 3), np.int64)
    return out if _cut(x, y, out) else None


@kernel
def _side(x: Floats, y: Floats, a: int, b: int, c: int) -> float:
    """Return twice the signed area of a triangle, negative if it is clockwise."""
    doubled: float = (x[b] - x[a]) * (y[c] - y[a]) - (y[b] - y[a]) * (x[c] - x[a])
    return doubled


@kernel
def _is_ear(x: Floats, y: Floats, before: Ints, after: Ints, b: int) -> bool:
    """Test whether a corner is convex and its triangle contains no other corner, except copies of its own three."""
    a, c = before[b], after[b]
    if not _side(x, y, a, b, c) >= 0:
        return False
    left, right = min(x[a], x[b], x[c]), max(x[a], x[b], x[c])
    low, high = min(y[a], y[b], y[c]), max(y[a], y[b], y[c])
    k = after[c]
    while k != a:
        if left <= x[k] <= right and low <= y[k] <= high:
            same = False
            for corner in (a, b, c):
                same |= x[k] == x[corner] and y[k] == y[corner]
            inside = _side(x, y, a, b, k) >= 0 and _side(x, y, b, c, k) >= 0 and _side(x, y, c, a, k) >= 0
            if inside and not same:
                return False
        k = after[k]
    return True


@kernel
def _mark(x: Floats, y: Floats, before: Ints, after: Ints, start: int, is_ear: Bools) -> None:
    """Mark which of the remaining corners are ears."""
    k = start
    while True:
        is_ear[k] = _is_ear(x, y, before, after, k)
        k = after[k]
        if k == start:
            break


@kernel
def _cut(x: Floats, y: Floats, out: Ints) -> bool:
    """Cut ears around the polygon, retesting the two neighbours of each; return False if no ear can be found."""
    count = len(x)
    before, after, is_ear = np.arange(-1, count - 1), np.arange(1, count + 1), np.zeros(count, np.bool_)
    before[0], after[count - 1] = count - 1, 0
    _mark(x, y, before, after, 0, is_ear)
    b = found = passed = 0
    passes = 1
    while found < count - 2:
        if passed > count - found:
            if passes == MOST_PASSES:
                return False
            _mark(x, y, before, after, b, is_ear)
            passes, passed = passes + 1, 0
            if not is_ear[b]:
                k = after[b]
                while k != b and not is_ear[k]:
                    k = after[k]
                if k == b:
                    return False
        if not is_ear[b]:
            b, passed = after[b], passed + 1
            continue
        a, c = before[b], after[b]
        out[found, 0], out[found, 1], out[found, 2] = a, b, c
        after[a], before[c] = c, a
        found, passed = found + 1, 0
        if found < count - 2:
            is_ear[a], is_ear[c] = _is_ear(x, y, before, after, a), _is_ear(x, y, before, after, c)
        b = c
    return True
