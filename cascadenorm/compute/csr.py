"""Compressed sparse rows: lists of unequal length in one array."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Csr(NamedTuple):
    """Rows of unequal length: row i is indices[indptr[i] : indptr[i + 1]]."""

    indptr: NDArray[np.int64]
    indices: NDArray[np.int32]

    @classmethod
    def of(cls, matrix: Any) -> "Csr":
        """Return the pattern of a scipy CSR matrix; its data are the values in the same order."""
        return cls(matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32))

    def row(self, i: int) -> NDArray[np.int32]:
        return self.indices[self.indptr[i] : self.indptr[i + 1]]

    @property
    def counts(self) -> NDArray[np.int64]:
        """Length of each row."""
        return np.diff(self.indptr)

    @property
    def rows(self) -> NDArray[np.int32]:
        """Row number of each entry, as in COO format with `indices` as the columns."""
        return np.repeat(np.arange(len(self.indptr) - 1, dtype=np.int32), self.counts)


def joined_rows(count: int, parts: list[tuple[NDArray[np.int64], NDArray[np.int32]]]) -> Csr:
    """Concatenate rows that were computed in ranges, given the row lengths and entries of each range."""
    indptr = np.zeros(count + 1, np.int64)
    if parts:
        np.cumsum(np.concatenate([counts for counts, _ in parts]), out=indptr[1:])
    return Csr(indptr, np.concatenate([found for _, found in parts]) if parts else np.empty(0, np.int32))


def grouped(colors: NDArray[np.int32]) -> Csr:
    """Return the indices of each colour, one row per colour from 0; colour -1 is left out."""
    order = np.argsort(colors, kind="stable").astype(np.int32)
    counts = np.bincount(colors + 1)
    return Csr(np.cumsum(counts) - counts[0], order[counts[0] :])
