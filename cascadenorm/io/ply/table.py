"""Locate the rows of one element of a PLY file without copying them.

A text body is first converted to numbers of eight bytes, so that the same code handles both formats.
"""

import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.ply.header import Element
from cascadenorm.mesh.polygons import ranges

Body = bytes | bytearray | memoryview


class PropertyKind(NamedTuple):
    """Numpy type of the values of a property and, for a list, of the length before them."""

    value: np.dtype[Any]
    length: np.dtype[Any] | None


class PropertyColumn(NamedTuple):
    """The values of one property, row after row."""

    kind: np.dtype[Any]  # of the values
    offsets: range | NDArray[np.int64]  # byte offset of the first value of each row; a range if the steps are equal
    counts: int | NDArray[np.int64]  # number of values in each row; one number if they are equal

    def view(self, body: Body) -> NDArray[Any]:
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
            return np.ascontiguousarray(self.view(body), self.kind.newbyteorder("=")).ravel()
        cells = self.places()[:, None] + np.arange(self.kind.itemsize)
        found = np.frombuffer(body, np.uint8)[cells].view(self.kind)[:, 0]
        return np.asarray(found.astype(self.kind.newbyteorder("=")))

    def put(self, body: bytearray, values: NDArray[Any], chosen: NDArray[np.bool_]) -> None:
        """Replace the chosen values. Each row has one value."""
        if isinstance(self.offsets, range):
            view = self.view(body)[:, 0]
            if chosen.all():  # twice as fast
                view[:] = values
            else:
                np.copyto(view, values, "unsafe", where=chosen)
            return
        cells = np.asarray(self.offsets)[chosen, None] + np.arange(self.kind.itemsize)
        raw = values[chosen].astype(self.kind)[:, None].view(np.uint8)
        np.frombuffer(body, np.uint8)[cells] = raw


def columns(body: Body, element: Element, start: int, kinds: list[PropertyKind]) -> tuple[list[PropertyColumn], int]:
    """Locate the properties, of these kinds, of all rows of an element that starts at a byte offset.

    The body is that of a binary file, or the numbers of a text body. Returns the columns, in the order of the
    properties, and the byte offset of the end of the element.
    """
    least = sum((kind.length or kind.value).itemsize for kind in kinds)
    if element.rows * least > len(body) - start:
        raise ReadError(
            f"the header declares {element.rows} rows of '{element.name}', but the file ends in row "
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
    lengths = PropertyColumn(kind.length, range(rows.start - size, rows.stop - size, rows.step), 1)
    return bool((lengths.view(body) == column.counts).all())


def _walk(
    body: Body, element: Element, start: int, kinds: list[PropertyKind], rows: int
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
        PropertyColumn(kind.value, np.array(place, np.int64), 1 if kind.length is None else _joined(count))
        for kind, place, count in zip(kinds, offsets, counts, strict=True)
    ], at


def _joined(counts: list[int]) -> int | NDArray[np.int64]:
    return counts[0] if len(set(counts)) == 1 else np.array(counts, np.int64)


def _code(kind: np.dtype[Any]) -> str:
    """Return the code of a type in the module struct."""
    return (">" if kind.str[0] == ">" else "<") + kind.char
