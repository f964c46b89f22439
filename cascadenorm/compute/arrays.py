"""Array types and operations on rows."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.compute.kernels import kernel
from cascadenorm.compute.threads import parallel_for, sums_in_blocks

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]
Index = int | np.integer[Any]  # an index or a count in kernels, which are compiled separately for each of its types
Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Vectors = NDArray[np.float64]  # (k, 3) float64: positions, normals or displacements


def as_array(values: ArrayLike, error: Exception) -> NDArray[Any]:
    """Return values as an array; raise the error for a list whose rows have different lengths."""
    try:
        return np.asarray(values)
    except ValueError:
        raise error from None


def unit(vectors: NDArray[Any], otherwise: NDArray[Any] | None = None) -> Vectors:
    """Scale each row to length 1; zero rows are replaced by `otherwise`, or stay zero."""
    scaled = np.zeros(vectors.shape)
    rows = (-1, vectors.shape[-1])
    zeros = parallel_for(
        math.prod(vectors.shape[:-1]),
        _unit_range,
        np.ascontiguousarray(vectors, np.float64).reshape(rows),
        scaled.reshape(rows),
    )
    if otherwise is None or not any(zeros):
        return scaled
    return np.where(scaled.any(axis=-1, keepdims=True), scaled, otherwise)


def all_in_rows(flags: Bools) -> Bools:
    """Return (k,) whether all flags of each row are set."""
    return np.asarray(np.logical_and.reduce(flags.T.copy()))


def any_in_rows(flags: Bools) -> Bools:
    """Return (k,) whether any flag of each row is set."""
    return np.asarray(np.logical_or.reduce(flags.T.copy()))


def box_of(points: NDArray[Any]) -> tuple[Floats, Floats]:
    """Return the lower and upper corners, (3,), of the bounding box of points."""
    columns = points.T
    return np.array([column.min() for column in columns]), np.array([column.max() for column in columns])


def first_of_each(labels: NDArray[np.integer[Any]]) -> Ints:
    """Return the (c,) first place of each of the labels 0 … c - 1, all of which occur."""
    first = np.empty(int(labels.max(initial=-1)) + 1, np.int64)
    first[labels[::-1]] = np.arange(len(labels))[::-1]  # of repeated places, numpy keeps the last value
    return first


def marked(places: NDArray[Any], count: int) -> Bools:
    """Return (count,) bool, set at the given places."""
    flags = np.zeros(count, bool)
    flags[places] = True
    return flags


def row_lengths(vectors: Vectors) -> Floats:
    """Return the (k,) lengths of the rows."""
    out = np.empty(len(vectors))
    parallel_for(len(out), _length_range, vectors, out)
    return out


def row_distances(points: Vectors, pairs: Ints32) -> Floats:
    """Return the (k,) distances between the points of each pair, (k, 2)."""
    out, points = np.empty(len(pairs)), points.view()
    points.flags.writeable = False  # same type as the vertices of a mesh, so that the kernel is compiled once
    parallel_for(len(out), _distance_range, points, pairs, out)
    return out


def pair_products(vectors: Vectors, pairs: Ints32) -> Floats:
    """Return the (k,) dot products of the vectors of each pair, (k, 2)."""
    out = np.empty(len(pairs))
    parallel_for(len(out), _product_range, vectors, pairs, out)
    return out


def angles_between(ours: Vectors, theirs: Vectors, *, undefined: float | None = None) -> Floats:
    """Return the angles in radians between corresponding unit rows, accurate at any angle.

    The angle of a pair with a zero row is `undefined`. If that is None, these pairs are left out.
    """
    proper = any_in_rows(ours != 0) & any_in_rows(theirs != 0)
    complete = bool(proper.all())
    if not complete:
        ours, theirs = ours[proper], theirs[proper]
    angles = np.asarray(2 * np.arctan2(row_lengths(ours - theirs), row_lengths(ours + theirs)))
    if complete or undefined is None:
        return angles
    every = np.full(len(proper), undefined)
    every[proper] = angles
    return every


def scatter_add(index: NDArray[np.integer[Any]], values: NDArray[Any], length: int) -> Floats:
    """Sum rows of values, (k, …), by index, (k,): out[index[i]] += values[i].

    The indices are within 0 … length - 1. Returns (length, …) float64; zero for rows without an index.
    """
    columns = math.prod(values.shape[1:])
    values = np.ascontiguousarray(values, np.result_type(values, np.float32))
    rows = values.reshape(len(index), columns)

    def add(start: int, stop: int, out: Floats) -> None:
        _scatter_add(np.ascontiguousarray(index[start:stop], np.int64), rows[start:stop], out)

    return sums_in_blocks(len(index), (length, columns), add).reshape(length, *values.shape[1:])


@kernel
def _unit_range(start: int, stop: int, vectors: Floats, out: Floats) -> int:
    """Scale nonzero rows to length 1, and return the number of other rows."""
    zeros = 0
    for i in range(start, stop):
        total = vectors[i, 0] * vectors[i, 0]
        for d in range(1, vectors.shape[1]):
            total += vectors[i, d] * vectors[i, d]
        size = np.sqrt(total)
        if size > 0:
            for d in range(vectors.shape[1]):
                out[i, d] = vectors[i, d] / size
        else:
            zeros += 1
    return zeros


@kernel
def _length_range(start: int, stop: int, vectors: Vectors, out: Floats) -> None:
    for i in range(start, stop):
        out[i] = np.sqrt(vectors[i, 0] ** 2 + vectors[i, 1] ** 2 + vectors[i, 2] ** 2)


@kernel
def _distance_range(start: int, stop: int, points: Vectors, pairs: Ints32, out: Floats) -> None:
    for i in range(start, stop):
        p, q = pairs[i]
        x, y, z = points[q, 0] - points[p, 0], points[q, 1] - points[p, 1], points[q, 2] - points[p, 2]
        out[i] = np.sqrt(x * x + y * y + z * z)


@kernel
def _product_range(start: int, stop: int, vectors: Vectors, pairs: Ints32, out: Floats) -> None:
    for i in range(start, stop):
        p, q = pairs[i]
        out[i] = vectors[p, 0] * vectors[q, 0] + vectors[p, 1] * vectors[q, 1] + vectors[p, 2] * vectors[q, 2]


@kernel
def _scatter_add(index: Ints, values: Floats, out: Floats) -> None:
    for i in range(len(index)):
        for column in range(values.shape[1]):
            out[index[i], column] += values[i, column]


@kernel
def doubled(values: Ints32) -> Ints32:
    """Return a copy of twice the length for further values; a loop compiles faster than a slice assignment."""
    larger = np.empty(2 * len(values), np.int32)
    for i in range(len(values)):
        larger[i] = values[i]
    return larger


def first_places(bad: Bools) -> str:
    """Format the indices of the first few true entries: '17, 18, 40, …'."""
    places = np.flatnonzero(bad)
    return ", ".join(map(str, places[:3])) + (", …" if len(places) > 3 else "")
