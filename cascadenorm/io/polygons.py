"""Faces of any number of corners, and their triangles."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import row_sums

MOST_APEXES = 64  # corners tried for a fan without folds; beyond, the fold stays


def ranges(starts: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Join the runs of `counts` successive numbers from each start."""
    first = np.cumsum(counts) - counts
    return np.repeat(starts - first, counts) + np.arange(int(counts.sum()))


class Polygons(NamedTuple):
    """Polygon i has the corners corners[indptr[i] : indptr[i + 1]]."""

    indptr: NDArray[np.int64]
    corners: NDArray[np.int64]

    @classmethod
    def from_counts(cls, counts: NDArray[np.int64], corners: NDArray[np.int64]) -> "Polygons":
        """Join polygons of the given numbers of corners."""
        return cls(np.concatenate([np.zeros(1, np.int64), np.cumsum(counts, dtype=np.int64)]), corners)

    @classmethod
    def from_rows(cls, rows: NDArray[np.int64]) -> "Polygons":
        """Join polygons that all have the same number of corners, one a row."""
        return cls(np.arange(len(rows) + 1, dtype=np.int64) * rows.shape[1], rows.ravel())

    def __len__(self) -> int:
        return len(self.indptr) - 1

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of corners of each polygon."""
        return np.diff(self.indptr)

    @property
    def owners(self) -> NDArray[np.int64]:
        """Polygon of each corner."""
        return np.repeat(np.arange(len(self)), self.counts)

    def misnamed(self, count: int) -> NDArray[np.bool_]:
        """Return which corners are not in 0 … count - 1."""
        return np.asarray((self.corners < 0) | (self.corners >= count))


def triangulate(positions: NDArray[Any], polygons: Polygons) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Cut polygons into fans around their first corner, or around the first one that gives no folded triangle.

    Parameters
    ----------
    positions : (k, 3)
    polygons : corners in 0 … k - 1; those with fewer than three corners have no triangle

    Returns
    -------
    (m, 3) corners of the triangles, and (m,) their polygons, ascending
    """
    counts = polygons.counts
    if (counts == 3).all():
        return polygons.corners.reshape(-1, 3), np.arange(len(polygons))
    owners, fans = _fans(polygons, np.arange(len(polygons)), 0)
    folded = np.unique(owners[_turned(positions, fans, owners)])
    for apex in range(1, MOST_APEXES):
        folded = folded[counts[folded] > max(apex, 3)]
        if not len(folded):
            break
        polygon, fan = _fans(polygons, folded, apex)
        still = np.isin(folded, polygon[_turned(positions, fan, polygon)])
        better = np.isin(polygon, folded[~still])
        fans[np.isin(owners, folded[~still])] = fan[better]
        folded = folded[still]
    return fans, owners


def _fans(polygons: Polygons, chosen: NDArray[np.int64], apex: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Cut the chosen polygons around one corner; the polygon of each triangle, and the triangles."""
    sizes = np.maximum(polygons.counts[chosen] - 2, 0)
    owners = np.repeat(chosen, sizes)
    step = ranges(np.zeros_like(sizes), sizes)  # 0, 1, … within each fan
    local = apex + np.stack([np.zeros_like(step), step + 1, step + 2], axis=1)
    places = polygons.indptr[owners, None] + local % polygons.counts[owners, None]
    return owners, polygons.corners[places]


def _turned(positions: NDArray[Any], triangles: NDArray[np.int64], owners: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which triangles face against the mean normal of their polygon."""
    with np.errstate(all="ignore"):  # a position need not be finite here
        normals = area_vectors(positions, triangles)
        sums = row_sums(owners, normals)
        return np.asarray(np.einsum("ij,ij->i", normals, sums[owners]) < 0)


def strips(counts: NDArray[np.int64], corners: NDArray[np.int64]) -> Polygons:
    """Cut triangle strips, which -1 ends and every other triangle of which is turned, into triangles."""
    ends = np.zeros(len(corners) + 1, bool)
    ends[np.cumsum(counts)] = True
    cut = np.concatenate([[True], (corners == -1) | ends[1:]])[: len(corners)]
    begin = np.maximum.accumulate(np.where(cut, np.arange(len(corners)), 0))
    window = np.arange(max(len(corners) - 2, 0))
    inside = ~ends[window + 1] & ~ends[window + 2] if len(window) else np.zeros(0, bool)
    triangles = np.stack([corners[window], corners[window + 1], corners[window + 2]], axis=1)
    odd = (window - begin[window]) % 2 == 1
    triangles[odd] = triangles[odd][:, [1, 0, 2]]
    return Polygons.from_rows(triangles[inside & (triangles != -1).all(axis=1)])


def area_vectors(positions: NDArray[Any], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the normal of each triangle times its area, up to one positive factor for all of them.

    The factor keeps coordinates of any size from overflowing.
    """
    largest = np.abs(positions).max(initial=0, where=np.isfinite(positions))
    with np.errstate(invalid="ignore"):  # triangles with corners that are not finite come out the same way
        scaled = positions / (np.float64(largest) if largest > 0 else 1.0)
        a, b, c = (scaled[triangles[:, corner]] for corner in range(3))
        return np.asarray(np.cross(b - a, c - a))
