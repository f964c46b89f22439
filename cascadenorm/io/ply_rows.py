"""Rows of the elements of a PLY file, as they are written."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.io.ply_header import NAMES, Element
from cascadenorm.io.polygons import Polygons
from cascadenorm.io.text import spelled


def binary_rows(element: Element, values: list[NDArray[Any]], byte_order: str) -> bytes:
    """Return further rows of an element."""
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


def text_rows(element: Element, values: list[NDArray[Any]]) -> list[bytes]:
    """Return further rows of an element, a line each."""
    words: list[NDArray[np.bytes_]] = []
    for p, value in zip(element.properties, values, strict=True):
        words += [spelled(np.full(len(value), value.shape[1]))] if p.count_kind else []
        kind = np.dtype("i8" if p.kind[0] != "f" else p.kind if value.dtype != np.float64 else "f8")
        words += [spelled(column) for column in value.astype(kind).T]
    return [b" ".join(row) for row in zip(*(column.tolist() for column in words), strict=True)]


def fields_of(values: Any) -> dict[str, NDArray[Any]]:
    """Return arrays of types that PLY has, under names without spaces, in little-endian order."""
    fields = {}
    for name, value in values.items():
        kind = value.dtype.str[1:] if value.dtype.str[1:] in NAMES else "f8"
        fields["_".join(name.split())] = value.astype("<" + kind)
    return fields


def face_rows(polygons: Polygons, length: str, fields: dict[str, NDArray[Any]]) -> bytes:
    """Join the rows of the element face, those with equally many corners at a time."""
    counts = polygons.counts
    extra = sum(v.dtype.itemsize for v in fields.values())
    sizes = np.dtype(length).itemsize + 4 * counts + extra
    starts = np.cumsum(sizes) - sizes
    out = np.zeros(int(sizes.sum()), np.uint8)
    for count in np.unique(counts).tolist():
        chosen = np.flatnonzero(counts == count)
        kinds = [
            ("n", length),
            ("corners", "<i4", (count,)),
            *[(f"{i}", v.dtype) for i, v in enumerate(fields.values())],
        ]
        rows = np.zeros(len(chosen), kinds)
        if len(chosen) == len(counts):
            rows["n"], rows["corners"] = count, polygons.corners.reshape(-1, count)
        else:
            rows["n"], rows["corners"] = count, polygons.corners[polygons.indptr[chosen, None] + np.arange(count)]
        for i, v in enumerate(fields.values()):
            rows[f"{i}"] = v[chosen]
        raw = np.frombuffer(rows.tobytes(), np.uint8).reshape(len(rows), -1)
        if len(chosen) == len(counts):
            return raw.tobytes()
        out[starts[chosen, None] + np.arange(raw.shape[1])] = raw
    return out.tobytes()
