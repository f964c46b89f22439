"""Encode rows of the elements of a PLY file."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.io.ply.header import NAMES, PlyElement
from cascadenorm.io.text.number_format import rows_of
from cascadenorm.io.text.text import blocks
from cascadenorm.mesh.polygons import Polygons


def binary_rows(element: PlyElement, values: list[NDArray[Any]], byte_order: str) -> bytes:
    """Return additional binary rows of an element."""
    lengths = [v.shape[1] for v in values]
    kinds: list[Any] = []
    for i, (p, length) in enumerate(zip(element.properties, lengths, strict=True)):
        kinds += [(f"length {i}", byte_order + p.count_kind)] if p.count_kind else []
        kinds += [(f"values {i}", byte_order + p.kind, (length,))]
    rows = np.zeros(len(values[0]), kinds)
    for i, (p, value) in enumerate(zip(element.properties, values, strict=True)):
        rows[f"values {i}"] = value
        if p.count_kind:
            rows[f"length {i}"] = lengths[i]
    return rows.tobytes()


def text_rows(element: PlyElement, values: list[NDArray[Any]]) -> list[bytes]:
    """Return additional text rows of an element, one line each."""
    words: list[list[bytes]] = []
    for p, value in zip(element.properties, values, strict=True):
        words += [rows_of(np.full((len(value), 1), value.shape[1]))] if p.count_kind else []
        kind = np.dtype("i8" if p.kind[0] != "f" else p.kind if value.dtype != np.float64 else "f8")
        words += [rows_of(column[:, None]) for column in value.astype(kind).T]
    return [b" ".join(row) for row in zip(*words, strict=True)]


def fields_of(values: Any) -> dict[str, NDArray[Any]]:
    """Return little-endian arrays of types that PLY supports, under names without spaces."""
    fields = {}
    for name, value in values.items():
        kind = value.dtype.str[1:] if value.dtype.str[1:] in NAMES else "f8"
        fields["_".join(name.split())] = value.astype("<" + kind, copy=False)
    return fields


def joined_columns(columns: list[NDArray[Any]]) -> Iterator[memoryview]:
    """Put columns, (rows,) or (rows, values) each, side by side. Yields the bytes of the table block by block."""
    return (_joined([column[block] for column in columns]).data for block in blocks(len(columns[0]), len(columns)))


def _joined(columns: list[NDArray[Any]]) -> NDArray[np.uint8]:
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
        return _joined([counts.astype(length), _as_units(corners), *values])
    sizes = np.dtype(length).itemsize + 4 * counts + sum(v.dtype.itemsize for v in values)
    starts = np.cumsum(sizes) - sizes
    out = np.empty(int(sizes.sum()), np.uint8)
    for count in np.unique(counts).tolist():
        chosen = np.flatnonzero(counts == count)
        corners = polygons.corners[polygons.indptr[chosen, None] + np.arange(count)]
        raw = _joined([counts[chosen].astype(length), _as_units(corners), *(v[chosen] for v in values)])
        out[starts[chosen, None] + np.arange(raw.shape[1])] = raw
    return out


def _as_units(corners: NDArray[np.int64]) -> NDArray[Any]:
    """Return the int32 corners of each row as a single value."""
    small = corners.astype("<i4")
    return small.view(f"V{4 * corners.shape[1]}")[:, 0] if corners.size else small
