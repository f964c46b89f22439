"""Values of all vertices or faces of a mesh on disk, in the order in which tiles have them."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLOCK = 1 << 18
"""Rows that are read at a time."""


class Layer:
    """A row for each vertex, or for each face in each of its tiles; rows that were never written are zero.

    Parameters
    ----------
    path : of the file
    kind : type of a row
    starts : (tiles + 1,) the first row of each tile, and how many there are
    """

    def __init__(self, path: Path, kind: Any, starts: NDArray[np.int64]) -> None:
        self._path, self._kind, self._starts = path, np.dtype(kind), starts

    def write(self, first: int, last: int, rows: NDArray[Any]) -> None:
        """Write the rows of all tiles from the first up to, but not with, the last; they are on disk afterwards."""
        start, end = self._starts[[first, last]].tolist()
        assert len(rows) == end - start
        with os.fdopen(os.open(self._path, os.O_RDWR | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666), "r+b") as file:
            size = self.rows * self._kind.itemsize
            if file.seek(0, os.SEEK_END) < size:
                file.truncate(size)
            file.seek(start * self._kind.itemsize)
            file.write(np.ascontiguousarray(rows, self._kind.base).tobytes())
            file.flush()
            os.fsync(file.fileno())

    def read(self, tiles: Iterable[int], rows: NDArray[np.int64]) -> NDArray[Any]:
        """Return rows by their places among those of some tiles, one tile after the other."""
        tiles = list(tiles)
        shape = (sum(int(self._starts[tile + 1] - self._starts[tile]) for tile in tiles),)
        place = np.full(shape, -1, np.int64)
        place[rows] = np.arange(len(rows))
        out, end = np.empty(len(rows), self._kind), 0
        with self._path.open("rb") as file:
            for tile in tiles:
                start, stop = self._starts[tile : tile + 2].tolist()
                file.seek(start * self._kind.itemsize)
                found = np.fromfile(file, self._kind, stop - start)
                wanted = place[end : end + stop - start]
                out[wanted[wanted >= 0]] = found[wanted >= 0]
                end += stop - start
        return out

    @property
    def rows(self) -> int:
        """How many rows there are."""
        return int(self._starts[-1])

    def blocks(self) -> Iterator[NDArray[Any]]:
        """Return all rows, one block after the other."""
        with self._path.open("rb") as file:
            for first in range(0, self.rows, BLOCK):
                yield np.fromfile(file, self._kind, min(BLOCK, self.rows - first))

    def remove(self) -> None:
        """Remove the file, if there is one."""
        self._path.unlink(missing_ok=True)
