"""Averages over neighbours, of vertices or of faces."""

from typing import TypeVar

import numpy as np

from cascadenorm.mesh import Csr, Floats, Floats32, kernel, parallel_for

Values = TypeVar("Values", Floats, Floats32)


def averaged(values: Values, neighbors: Csr, passes: int, *, spare: Values | None = None) -> Values:
    """Replace each row by the mean of itself and of the rows of its neighbours, so many times.

    Parameters
    ----------
    values : (n, p)
    neighbors : n rows
    passes : at least 1
    spare : as the values, overwritten, for what lies between passes; None: a new one

    Returns
    -------
    (n, p), of the type of the values
    """
    out = np.empty_like(values)
    between = np.empty_like(values) if spare is None else spare
    for left in range(passes, 0, -1):
        after = out if left % 2 else between
        parallel_for(len(values), _mean_range, values, neighbors, after)
        values = after
    return values


@kernel
def _mean_range(start: int, stop: int, values: Values, neighbors: Csr, out: Values) -> None:
    """One pass; iteration i alone writes out[i]."""
    for i in range(start, stop):
        for p in range(values.shape[1]):
            out[i, p] = values[i, p]
        for k in range(neighbors.indptr[i], neighbors.indptr[i + 1]):
            j = neighbors.indices[k]
            for p in range(values.shape[1]):
                out[i, p] += values[j, p]
        for p in range(values.shape[1]):
            out[i, p] /= 1 + neighbors.indptr[i + 1] - neighbors.indptr[i]
