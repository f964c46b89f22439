"""Averages over neighbouring vertices or faces."""

from typing import TypeVar

import numpy as np

from cascadenorm.mesh import Csr, Floats, Floats32, kernel, parallel_for

Values = TypeVar("Values", Floats, Floats32)


def averaged(values: Values, neighbors: Csr, passes: int) -> Values:
    """Replace each value, (n,), or row, (n, p), by the mean over itself and its neighbours, at least once."""
    run = _mean_range if values.ndim == 2 else _mean_number_range
    out, between = np.empty_like(values), np.empty_like(values)
    for left in range(passes, 0, -1):
        after = out if left % 2 else between
        parallel_for(len(values), run, values, neighbors, after)
        values = after
    return values


def averaged_around(values: Values, around: Csr) -> Values:
    """Return the mean of the values, (m, p), that each row of a pattern lists; zero for empty rows."""
    out = np.empty((len(around.indptr) - 1, values.shape[1]), values.dtype)
    parallel_for(len(out), _mean_around_range, values, around, out)
    return out


@kernel
def _mean_number_range(start: int, stop: int, values: Values, neighbors: Csr, out: Values) -> None:
    """Compute one averaging pass over scalar values."""
    for i in range(start, stop):
        first, last = neighbors.indptr[i], neighbors.indptr[i + 1]
        total = values[i]
        for k in range(first, last):
            total += values[neighbors.indices[k]]
        out[i] = total / (1 + last - first)


@kernel
def _mean_range(start: int, stop: int, values: Values, neighbors: Csr, out: Values) -> None:
    """Compute one averaging pass over rows; only iteration i writes out[i]."""
    for i in range(start, stop):
        first, last, total = neighbors.indptr[i], neighbors.indptr[i + 1], out[i]
        for p in range(len(total)):
            total[p] = values[i, p]

        # two neighbours at a time
        for k in range(first, last - 1, 2):
            one, other = neighbors.indices[k], neighbors.indices[k + 1]
            for p in range(len(total)):
                total[p] = total[p] + values[one, p] + values[other, p]
        if (last - first) % 2:
            one = neighbors.indices[last - 1]
            for p in range(len(total)):
                total[p] += values[one, p]

        count = values.dtype.type(1 + last - first)
        for p in range(len(total)):
            total[p] /= count


@kernel
def _mean_around_range(start: int, stop: int, values: Values, around: Csr, out: Values) -> None:
    """Average the values listed in each row; only iteration i writes out[i]."""
    for i in range(start, stop):
        first, last, total = around.indptr[i], around.indptr[i + 1], out[i]
        for p in range(len(total)):
            total[p] = 0
        for k in range(first, last):
            one = around.indices[k]
            for p in range(len(total)):
                total[p] += values[one, p]
        count = values.dtype.type(max(last - first, 1))
        for p in range(len(total)):
            total[p] /= count
