"""Polygonal faces and their triangulation."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.arrays import Bools, Floats, Floats32, Ints, marked, scatter_add
from cascadenorm.mesh import face_area_vectors, kernel, parallel_for, repeats_vertex
from cascadenorm.mesh.vectors import Three, Vector, area_vector, divided, length, row

MOST_APEXES = 64  # corners tried for a fan without folded triangles
MOST_CORNERS = 20_000  # largest number of corners of a polygon that is triangulated; the time grows quadratically
MOST_PASSES = 16  # over all corners, needed where rounding errors hide ears; one is nearly always enough


def ranges(starts: Ints, counts: Ints) -> Ints:
    """Concatenate the ranges of `counts` consecutive integers from each start."""
    if len(counts) and (counts == counts[0]).all():
        return (starts[:, None] + np.arange(counts[0])).ravel()
    first = np.cumsum(counts) - counts
    return np.repeat(starts - first, counts) + np.arange(int(counts.sum()))


class Polygons(NamedTuple):
    """Polygon i has the corners corners[indptr[i] : indptr[i + 1]]."""

    indptr: Ints
    corners: Ints

    @classmethod
    def from_counts(cls, counts: Ints, corners: Ints) -> "Polygons":
        """Create polygons with the given numbers of corners."""
        return cls(np.concatenate([np.zeros(1, np.int64), np.cumsum(counts, dtype=np.int64)]), corners)

    @classmethod
    def from_rows(cls, rows: Ints) -> "Polygons":
        """Create polygons from rows of corners; all have the same number of corners."""
        return cls(np.arange(0, rows.size + 1, rows.shape[1], dtype=np.int64), rows.ravel())

    @classmethod
    def joined(cls, parts: Sequence["Polygons"]) -> "Polygons":
        """Put the polygons of all parts one after another."""
        none = np.zeros(0, np.int64)
        counts = np.concatenate([none, *(part.counts for part in parts)])
        return cls.from_counts(counts, np.concatenate([none, *(part.corners for part in parts)]))

    def __len__(self) -> int:
        return len(self.indptr) - 1

    def part(self, block: slice) -> "Polygons":
        indptr = self.indptr[block.start : block.stop + 1]
        return Polygons(indptr - indptr[0], self.corners[indptr[0] : indptr[-1]])

    def by_count(self) -> Iterator[tuple[Ints, Ints]]:
        """Yield the polygons by number of corners, ascending: their indices, (k,), and their corners, (k, count)."""
        counts = self.counts
        for count in np.unique(counts).tolist():
            chosen = np.flatnonzero(counts == count)
            yield chosen, self.corners[self.indptr[chosen, None] + np.arange(count)]

    @property
    def counts(self) -> Ints:
        """Number of corners of each polygon."""
        return np.diff(self.indptr)

    @property
    def owners(self) -> Ints:
        """Polygon of each corner."""
        return np.repeat(np.arange(len(self)), self.counts)

    def out_of_range(self, count: int) -> Bools:
        """Return whether each corner is outside 0 … count - 1."""
        return np.asarray((self.corners < 0) | (self.corners >= count))

    def moved_to(self, first: int, count: int) -> "Polygons":
        """Return the polygons with `first` added to their corners; corners outside 0 … count - 1 become -1."""
        return Polygons(self.indptr, np.where(self.out_of_range(count), -1, self.corners + first))


def triangulate(positions: NDArray[Any], polygons: Polygons) -> tuple[Ints, Ints]:
    """Triangulate polygons with corners in 0 … k - 1; those with fewer than three corners give no triangle.

    Each polygon becomes a fan around the first corner that gives no folded triangle. If there is no such corner, as in
    the letter U, the polygon is triangulated by ear clipping. The positions are (k, 3). Returns the (m, 3) corners of
    the triangles, and (m,) the polygon of each, ascending.
    """
    counts = polygons.counts
    if (counts == 3).all():
        return polygons.corners.reshape(-1, 3), np.arange(len(polygons))
    owners, fans = _fans(polygons, np.arange(len(polygons)), 0)
    folded = np.unique(owners[_turned(positions, fans, owners)])
    for apex in range(1, MOST_APEXES):
        trying = folded[counts[folded] > max(apex, 3)]
        if not len(trying):
            break
        polygon, fan = _fans(polygons, trying, apex)
        still = np.isin(trying, polygon[_turned(positions, fan, polygon)])
        better = np.isin(polygon, trying[~still])
        fans[np.isin(owners, trying[~still])] = fan[better]
        folded = np.setdiff1d(folded, trying[~still])
    ends = np.cumsum(np.maximum(counts - 2, 0))
    for number in folded[counts[folded] > 4].tolist():
        corners = polygons.corners[polygons.indptr[number] : polygons.indptr[number + 1]]
        if (cut := ears(positions[corners])) is not None:
            fans[ends[number] - len(cut) : ends[number]] = corners[cut]
    return fans, owners


def _fans(polygons: Polygons, chosen: Ints, apex: int) -> tuple[Ints, Ints]:
    """Cut the chosen polygons into fans around one corner; return the polygon and the corners of each triangle."""
    sizes = np.maximum(polygons.counts[chosen] - 2, 0)
    owners = np.repeat(chosen, sizes)
    step = ranges(np.zeros_like(sizes), sizes)  # 0, 1, … within each fan
    local = apex + np.stack([np.zeros_like(step), step + 1, step + 2], axis=1)
    places = polygons.indptr[owners, None] + local % polygons.counts[owners, None]
    return owners, polygons.corners[places]


def _turned(positions: NDArray[Any], triangles: Ints, owners: Ints) -> Bools:
    """Return whether each triangle is opposite to the mean normal of its polygon."""
    with np.errstate(all="ignore"):  # positions may be non-finite here
        normals = face_area_vectors(near_one(positions), triangles.astype(np.int32))
        sums = scatter_add(owners, normals, int(owners.max(initial=-1)) + 1)
        return np.asarray(np.einsum("ij,ij->i", normals, sums[owners]) < 0)


def strips(counts: Ints, corners: Ints) -> Polygons:
    """Convert triangle strips, optionally terminated by -1, to consistently oriented triangles.

    Triangles that repeat a vertex only connect two strips and are removed.
    """
    ends = marked(np.cumsum(counts), len(corners) + 1)
    cut = np.concatenate([[True], (corners == -1) | ends[1:]])[: len(corners)]
    begin = np.maximum.accumulate(np.where(cut, np.arange(len(corners)), 0))
    window = np.arange(max(len(corners) - 2, 0))
    inside = ~ends[window + 1] & ~ends[window + 2] if len(window) else np.zeros(0, bool)
    triangles = np.stack([corners[window], corners[window + 1], corners[window + 2]], axis=1)
    odd = (window - begin[window]) % 2 == 1
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    return Polygons.from_rows(triangles[inside & (triangles != -1).all(axis=1) & ~repeats_vertex(triangles)])


def fans(counts: Ints, corners: Ints) -> Polygons:
    """Convert triangle fans to triangles. Triangles that repeat a vertex are removed, as in `strips`."""
    _, triangles = _fans(Polygons.from_counts(counts, corners), np.arange(len(counts)), 0)
    return Polygons.from_rows(triangles[~repeats_vertex(triangles)])


def near_one(positions: NDArray[Any]) -> Floats:
    """Return the positions divided by the largest coordinate."""
    with np.errstate(invalid="ignore"):  # triangles with non-finite corners stay non-finite
        scaled = np.array(positions, np.float64, order="C")
        scaled /= largest_coordinate(positions)
    return scaled


def largest_coordinate(positions: NDArray[Any]) -> float:
    """Return the largest absolute finite coordinate, or 1 if all are zero; dividing by it prevents overflow."""
    largest = np.maximum(positions.max(initial=0), -positions.min(initial=0))
    if not np.isfinite(largest):
        largest = np.abs(positions).max(initial=0, where=np.isfinite(positions))
    return float(largest) if largest > 0 else 1.0


def unit_normals(positions: NDArray[Any], triangles: Ints, largest: float) -> Floats32:
    """Return the (m, 3) unit normals of triangles; zero for triangles without area.

    Triangles index the positions, (k, 3). `largest` is the result of `largest_coordinate` for these positions, or for a
    superset.
    """
    out = np.empty(triangles.shape, np.float32)
    with np.errstate(invalid="ignore"):  # positions may be NaN where invalid faces are isolated
        parallel_for(len(out), _unit_normal_range, positions, triangles, largest, out)
    return out


@kernel
def _unit_normal_range(
    start: int, stop: int, positions: NDArray[Any], triangles: Ints, largest: float, out: Floats32
) -> None:
    for f in range(start, stop):
        a, b, c = row(positions, triangles[f, 0]), row(positions, triangles[f, 1]), row(positions, triangles[f, 2])
        out[f, 0], out[f, 1], out[f, 2] = unit_normal(a, b, c, largest)


@kernel
def unit_normal(a: Three, b: Three, c: Three, largest: float) -> Vector:
    """Return the unit normal of a triangle, zero without area; coordinates are divided by `largest` first."""
    normal = area_vector(divided(a, largest), divided(b, largest), divided(c, largest))
    size = length(normal)
    return divided(normal, size) if size > 0 else (0.0, 0.0, 0.0)


def ears(corners: NDArray[Any]) -> Ints | None:
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
