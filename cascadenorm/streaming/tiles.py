"""Space cut into tiles of about equally many vertices, and what lies in each, on disk."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Vectors


class Cuts(NamedTuple):
    """A binary tree of planes: node k has the halves 2k and 2k + 1, from node 1 on.

    Parameters
    ----------
    depth : planes between the whole and a tile; there are 2**depth tiles
    axis, place : (2**depth,) the plane of each node
    """

    depth: int
    axis: NDArray[np.int64]
    place: NDArray[np.float64]

    def tile(self, points: NDArray[Any]) -> NDArray[np.int32]:
        """Return (k,) the tile of each point."""
        node, rows = np.ones(len(points), np.int64), np.arange(len(points))
        for _ in range(self.depth):
            node = 2 * node + (points[rows, self.axis[node]] > self.place[node])
        return np.asarray(node - 2**self.depth, np.int32)


def cuts_of(sample: Vectors, depth: int) -> Cuts:
    """Halve points again and again at the median of their longest extent, so that tiles are compact."""
    axis, place = np.zeros(2**depth, np.int64), np.zeros(2**depth)
    nodes = {1: sample}
    for node in range(1, 2**depth):
        points = nodes.pop(node)
        if len(points):
            axis[node] = np.ptp(points, axis=0).argmax()
            place[node] = np.median(points[:, axis[node]])
        right = points[:, axis[node]] > place[node]
        nodes[2 * node], nodes[2 * node + 1] = points[~right], points[right]
    return Cuts(depth, axis, place)


class Buckets:
    """Rows in a file, block after block, each sorted by tile; complete once it is closed.

    Parameters
    ----------
    path : of the file; the places of the rows are beside it
    kind : type of a row
    tiles : how many there are
    """

    def __init__(self, path: Path, kind: Any, tiles: int) -> None:
        self._path, self._kind, self.count = path, np.dtype(kind), tiles
        self._places = np.empty((0, tiles + 1), np.int64)  # of each block

    def write(self, blocks: Any) -> None:
        """Write blocks of rows, each with the tile of each row."""
        places, end = [], 0
        with self._path.open("wb") as file:
            for rows, tile in blocks:
                counts = np.bincount(tile, minlength=self.count)
                places.append(end + np.concatenate([[0], np.cumsum(counts)]))
                end += len(rows)
                rows[np.argsort(tile, kind="stable")].astype(self._kind.base).tofile(file)
        self._places = np.stack(places)
        np.save(self._index, self._places)

    def read(self, tile: int) -> NDArray[Any]:
        """Return the rows of a tile, in the order in which they came."""
        if not len(self._places):
            self._places = np.load(self._index)
        places, found = self._places, []
        with self._path.open("rb") as file:
            for start, end in zip(places[:, tile], places[:, tile + 1], strict=True):
                if end > start:
                    file.seek(int(start) * self._kind.itemsize)
                    found.append(np.fromfile(file, self._kind, int(end - start)))
        return np.concatenate(found) if found else np.empty(0, self._kind)

    @property
    def starts(self) -> NDArray[np.int64]:
        """(tiles + 1,) where the rows of each tile begin if those of one follow on those of the other."""
        if not len(self._places):
            self._places = np.load(self._index)
        return np.concatenate([[0], np.cumsum(np.diff(self._places, axis=1).sum(axis=0))])

    def remove(self) -> None:
        """Remove the files."""
        self._path.unlink()
        self._index.unlink()

    @property
    def _index(self) -> Path:
        return self._path.with_suffix(".npy")
