"""Locate the rows of the elements of a PLY file without copying them, and encode rows.

A text body is first converted to numbers of eight bytes, so that the same code handles both formats.
"""

import struct
from collections.abc import Collection, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError, counted
from cascadenorm.io.content import with_distinct_names
from cascadenorm.io.ply.header import NAMES, PlyElement, PlyProperty
from cascadenorm.io.text.number_format import rows_of
from cascadenorm.io.text.text import blocks
from cascadenorm.mesh.polygons import Polygons, ranges

Body = bytes | memoryview


class PropertyKind(NamedTuple):
    """Numpy type of the values of a property and, for a list, of the length before them."""

    value: np.dtype[Any]
    length: np.dtype[Any] | None


class PropertyColumn(NamedTuple):
    """The values of one property, row after row."""

    declared: PlyProperty
    kind: np.dtype[Any]  # of the values
    offsets: range | NDArray[np.int64]  # byte offset of the first value of each row; a range if the steps are equal
    counts: int | NDArray[np.int64]  # number of values in each row; one number if they are equal

    def view(self, body: Body | NDArray[np.uint8]) -> NDArray[Any]:
        """View the values in a body, (rows, values). Only for equal steps and counts."""
        assert isinstance(self.offsets, range) and isinstance(self.counts, int)
        if not self.offsets or not self.counts:
            return np.zeros((len(self.offsets), self.counts), self.kind)
        strides = (self.offsets.step, self.kind.itemsize)
        return np.ndarray((len(self.offsets), self.counts), self.kind, body, self.offsets.start, strides)

    def places(self) -> NDArray[np.int64]:
        """Return the byte offset of each value, row after row."""
        counts = np.broadcast_to(np.asarray(self.counts, np.int64), len(self.offsets))
        steps = ranges(np.zeros_like(counts), counts)
        return np.repeat(np.asarray(self.offsets, np.int64), counts) + steps * self.kind.itemsize

    def read(self, body: Body) -> NDArray[Any]:
        """Return all values, row after row, in native byte order."""
        if isinstance(self.offsets, range):
            return np.asarray(self.view(body).ravel().astype(self.kind.newbyteorder("=")))
        cells = self.places()[:, None] + np.arange(self.kind.itemsize)
        found = np.frombuffer(body, np.uint8)[cells].view(self.kind)[:, 0]
        return np.asarray(found.astype(self.kind.newbyteorder("=")))

    def put(self, body: NDArray[np.uint8], values: NDArray[Any], chosen: NDArray[np.bool_]) -> None:
        """Replace the chosen values. Each row has one value."""
        if isinstance(self.offsets, range):
            np.copyto(self.view(body)[:, 0], values, "unsafe", where=chosen)
            return
        cells = np.asarray(self.offsets)[chosen, None] + np.arange(self.kind.itemsize)
        raw = values[chosen].astype(self.kind)[:, None].view(np.uint8)
        body[cells] = raw


def columns(body: Body, element: PlyElement, start: int, kinds: list[PropertyKind]) -> tuple[list[PropertyColumn], int]:
    """Locate the properties, of these kinds, of all rows of an element that starts at a byte offset.

    The body is that of a binary file, or the numbers of a text body. Returns the columns, in the order of the
    properties, and the byte offset of the end of the element.
    """
    least = sum((kind.length or kind.value).itemsize for kind in kinds)
    if element.rows * least > len(body) - start:
        raise ReadError(
            f"the header declares {counted(element.rows, 'row')} of '{element.name}', but the file ends in row "
            f"{(len(body) - start) // least}: it is truncated, or its header is wrong; get a complete copy"
        )
    found, stop = _walk(body, element, start, kinds, min(1, element.rows))
    if element.rows < 2:
        return found, stop
    step = stop - start
    equal = [
        column._replace(offsets=range(at := int(column.offsets[0]), at + step * element.rows, step)) for column in found
    ]
    stop = start + step * element.rows
    if stop <= len(body) and all(map(_has_equal_lengths, equal, kinds, [body] * len(kinds))):
        return equal, stop
    return _walk(body, element, start, kinds, element.rows)


def _has_equal_lengths(column: PropertyColumn, kind: PropertyKind, body: Body) -> bool:
    """Test whether all lists of a column that was extrapolated from its first row have the length of the first."""
    if kind.length is None:
        return True
    assert isinstance(column.offsets, range)
    size, rows = kind.length.itemsize, column.offsets
    lengths = column._replace(kind=kind.length, offsets=range(rows.start - size, rows.stop - size, rows.step), counts=1)
    return bool((lengths.view(body) == column.counts).all())


def _walk(
    body: Body, element: PlyElement, start: int, kinds: list[PropertyKind], rows: int
) -> tuple[list[PropertyColumn], int]:
    """Locate the first rows of an element one by one."""
    at, end = start, len(body)
    offsets: list[list[int]] = [[] for _ in kinds]
    counts: list[list[int]] = [[] for _ in kinds]
    lengths = [None if kind.length is None else struct.Struct(_code(kind.length)) for kind in kinds]
    plan = list(zip([kind.value.itemsize for kind in kinds], lengths, offsets, counts, strict=True))
    for row in range(rows):
        for size, length, row_offsets, row_counts in plan:
            count = 1
            if length is not None:
                count = length.unpack_from(body, at)[0] if at + length.size <= end else -1
                at += length.size
            if not (count >= 0 and at + size * count <= end and count == (count := int(count))):
                raise ReadError(
                    f"row {row} of '{element.name}' runs past the end of the file: the file is truncated, "
                    "or the length of a list in it is wrong; get a complete copy"
                )
            row_offsets.append(at)
            row_counts.append(count)
            at += size * count
    return [
        PropertyColumn(p, kind.value, np.array(place, np.int64), 1 if kind.length is None else _joined(count))
        for p, kind, place, count in zip(element.properties, kinds, offsets, counts, strict=True)
    ], at


def _joined(counts: list[int]) -> int | NDArray[np.int64]:
    return counts[0] if len(set(counts)) == 1 else np.array(counts, np.int64)


def _code(kind: np.dtype[Any]) -> str:
    """Return the code of a type in the module struct."""
    return (">" if kind.str[0] == ">" else "<") + kind.char


def binary_rows(element: PlyElement, values: list[NDArray[Any]], byte_order: str) -> bytes:
    """Return additional binary rows of an element."""
    columns: list[NDArray[Any]] = []
    for p, value in zip(element.properties, values, strict=True):
        columns += [np.full(len(value), value.shape[1], byte_order + p.count_kind)] if p.count_kind else []
        columns += [value.astype(byte_order + p.kind)]
    return _beside(columns).tobytes()


def text_rows(element: PlyElement, values: list[NDArray[Any]]) -> list[bytes]:
    """Return additional text rows of an element, one line each."""
    words: list[list[bytes]] = []
    for p, value in zip(element.properties, values, strict=True):
        words += [rows_of(np.full((len(value), 1), value.shape[1]))] if p.count_kind else []
        kind = np.dtype("i8" if p.kind[0] != "f" else p.kind if value.dtype != np.float64 else "f8")
        words += [rows_of(column[:, None]) for column in value.astype(kind).T]
    return [b" ".join(row) for row in zip(*words, strict=True)]


def fields_of(values: Mapping[str, NDArray[Any]], taken: Collection[str] = ()) -> dict[str, NDArray[Any]]:
    """Return little-endian arrays of types that PLY supports, under names without spaces that are not taken."""
    fields = with_distinct_names(values, lambda name: "_".join(name.split()) or "_", taken)
    kinds = {name: kind if (kind := value.dtype.str[1:]) in NAMES else "f8" for name, value in fields.items()}
    return {name: value.astype("<" + kinds[name], copy=False) for name, value in fields.items()}


def joined_columns(columns: list[NDArray[Any]]) -> Iterator[memoryview]:
    """Put columns, (rows,) or (rows, values) each, side by side. Yields the bytes of the table block by block."""
    return (_beside([column[block] for column in columns]).data for block in blocks(len(columns[0]), len(columns)))


def _beside(columns: list[NDArray[Any]]) -> NDArray[np.uint8]:
    """Put columns side by side. Returns bytes, one table row per row."""
    rows = np.empty(len(columns[0]), [(f"{i}", column.dtype, column.shape[1:]) for i, column in enumerate(columns)])
    for i, column in enumerate(columns):
        rows[f"{i}"] = column
    return rows.view(np.uint8).reshape(len(rows), rows.itemsize)


def list_rows(polygons: Polygons, length: str, fields: dict[str, NDArray[Any]]) -> Iterator[memoryview]:
    """Yield the bytes of the rows of the element `face`, block by block."""
    for block in blocks(len(polygons), 4 + len(fields)):
        yield _face_rows(polygons.part(block), length, [values[block] for values in fields.values()]).data


def _face_rows(polygons: Polygons, length: str, values: list[NDArray[Any]]) -> NDArray[np.uint8]:
    """Return the bytes of some rows. Rows with equal numbers of corners are encoded together."""
    counts = polygons.counts
    if (counts == counts[0]).all():
        corners = polygons.corners.reshape(len(counts), -1)
        return _beside([counts.astype(length), _as_units(corners), *values])
    sizes = np.dtype(length).itemsize + 4 * counts + sum(v.dtype.itemsize for v in values)
    starts = np.cumsum(sizes) - sizes
    out = np.empty(int(sizes.sum()), np.uint8)
    for chosen, corners in polygons.by_count():
        raw = _beside([counts[chosen].astype(length), _as_units(corners), *(v[chosen] for v in values)])
        out[starts[chosen, None] + np.arange(raw.shape[1])] = raw
    return out


def _as_units(corners: NDArray[np.int64]) -> NDArray[Any]:
    """Return the int32 corners of each row as a single value."""
    small = corners.astype("<i4")
    return small.view(f"V{4 * corners.shape[1]}")[:, 0] if corners.size else small
