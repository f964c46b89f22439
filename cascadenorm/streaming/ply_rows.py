"""The tables of a binary PLY file of triangles, read and written in blocks."""

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.ply.header import Element, parse_header

BLOCK = 1 << 18
"""Rows of a block."""

HEAD = 1 << 16
"""Largest size of a header, in bytes."""

CORNERS = ("vertex_indices", "vertex_index")
NORMALS = ("nx", "ny", "nz")
ELSEWHERE = "convert it, or denoise it where the whole fits into memory"


class Table(NamedTuple):
    """Rows of equal size.

    Parameters
    ----------
    start : byte of the file
    rows : how many there are
    kind : type of a row
    """

    start: int
    rows: int
    kind: np.dtype[Any]

    @property
    def end(self) -> int:
        """Byte after the last row."""
        return self.start + self.rows * self.kind.itemsize


class PlyTables(NamedTuple):
    """Where vertices and faces lie in a file.

    Parameters
    ----------
    vertices : with fields x, y, z of one type
    faces : with fields `count`, which is 3, and `corners`
    source : what messages call it, a file that this one was made of
    """

    path: Path
    vertices: Table
    faces: Table
    source: Path

    @property
    def kind(self) -> np.dtype[Any]:
        """Type of the positions, in the byte order of the machine."""
        return self.vertices.kind["x"].newbyteorder("=")

    def vertex_blocks(self) -> Iterator[tuple[int, NDArray[Any]]]:
        """Return the number of the first vertex, and rows, for one block after the other."""
        return _blocks(self.path, self.vertices)

    def positions(self) -> Iterator[tuple[int, NDArray[Any]]]:
        """Return the number of the first vertex, and positions, (k, 3), for one block after the other."""
        return ((first, positions_of(rows)) for first, rows in self.vertex_blocks())

    def positions_of(self, numbers: NDArray[Any]) -> NDArray[Any]:
        """Return the positions of some vertices, (k, 3)."""
        table = self.vertices
        return positions_of(np.memmap(self.path, table.kind, "r", table.start, (table.rows,))[numbers])

    def corners(self) -> Iterator[tuple[int, NDArray[np.int64]]]:
        """Return the number of the first face, and corners, (k, 3), for one block after the other.

        Raises
        ------
        ReadError : a face that is no triangle, repeats a vertex, or references one that does not exist
        """
        for first, rows in _blocks(self.path, self.faces):
            corners = rows["corners"].astype(np.int64)
            a, b, c = corners.T
            for wrong, what in (
                (rows["count"] != 3, "is not a triangle"),
                (
                    (corners < 0).any(axis=1) | (corners >= self.vertices.rows).any(axis=1),
                    "references a vertex that does not exist",
                ),
                ((a == b) | (b == c) | (c == a), "repeats a vertex"),
            ):
                if wrong.any():
                    raise ReadError(f"face {first + int(wrong.argmax())} {what}", hint=ELSEWHERE).within(
                        str(self.source)
                    )
            yield first, corners

    def moved(self, moved: NDArray[Any]) -> Iterator[bytes]:
        """Return the bytes of the file with other positions, (n, 3), in pieces; what stays keeps its bits."""
        yield from _bytes(self.path, 0, self.vertices.start)
        for first, rows in self.vertex_blocks():
            for axis, name in enumerate("xyz"):
                there = moved[first : first + len(rows), axis]
                rows[name] = np.where(there == rows[name], rows[name], there)
            yield rows.tobytes()
        yield from _bytes(self.path, self.vertices.end, os.path.getsize(self.path))


def ply_tables(path: Path) -> PlyTables:
    """Find the tables of a file.

    Raises
    ------
    ReadError : not a binary PLY file of triangles, with positions in one floating type and without normals
    """
    try:
        with path.open("rb") as file:
            head, size = file.read(HEAD), os.path.getsize(path)
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise ReadError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    try:
        if not head.startswith(b"ply"):
            raise ReadError("the file is not PLY, and only binary PLY and STL can be read in parts", hint=ELSEWHERE)
        header = parse_header(head)
        if not header.byte_order:
            raise ReadError("the file is ASCII PLY, and only binary PLY can be read in parts", hint=ELSEWHERE)
        start, tables = header.length, dict[str, Table]()
        for element in header.elements:
            if {"vertex", "face"} <= tables.keys():
                break  # what follows is copied as it is
            tables[element.name] = Table(start, element.rows, _row(element, header.byte_order))
            start = tables[element.name].end
        if not {"vertex", "face"} <= tables.keys():
            raise ReadError("the PLY header has no elements 'vertex' and 'face': this is not a mesh")
        if start > size:
            raise ReadError(f"the PLY header declares {start} bytes and the file has {size}: it is truncated")
    except ReadError as error:
        raise error.within(str(path)) from error.__cause__
    return PlyTables(path, tables["vertex"], tables["face"], path)


def write_tables(
    path: Path,
    kind: np.dtype[Any],
    vertices: int,
    faces: int,
    positions: Iterable[NDArray[Any]],
    corners: Iterable[NDArray[Any]],
) -> None:
    """Write a mesh of blocks of positions, (k, 3), of a floating type, and of corners, (k, 3)."""
    face = np.dtype([("count", "u1"), ("corners", "<u4", (3,))])
    with path.open("wb") as file:
        file.write(
            f"ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\n".encode()
            + b"".join(f"property {'float' if kind.itemsize == 4 else 'double'} {axis}\n".encode() for axis in "xyz")
            + f"element face {faces}\nproperty list uchar uint vertex_indices\nend_header\n".encode()
        )
        for xyz in positions:
            xyz.astype(kind.newbyteorder("<")).tofile(file)
        for block in corners:
            rows = np.empty(len(block), face)
            rows["count"], rows["corners"] = 3, block
            rows.tofile(file)


def positions_of(rows: NDArray[Any]) -> NDArray[Any]:
    """Return the positions of rows of vertices, (k, 3), in the byte order of the machine."""
    found = np.stack([rows[name] for name in "xyz"], axis=1)
    return found.astype(found.dtype.newbyteorder("="))


def _row(element: Element, byte_order: str) -> np.dtype[Any]:
    fields: list[Any] = []
    for p in element.properties:
        if p.count_kind is None:
            fields.append((p.name, byte_order + p.kind))
        elif element.name == "face" and p.name in CORNERS and p.kind in ("i4", "u4"):
            fields += [("count", byte_order + p.count_kind), ("corners", byte_order + p.kind, (3,))]
        else:
            raise ReadError(
                f"the element '{element.name}' has a list property '{p.name}', so its rows have no fixed size",
                hint=ELSEWHERE,
            )
    names = [field[0] for field in fields]
    if element.name == "face" and "corners" not in names:
        raise ReadError("the faces have no list property 'vertex_indices'", hint="export the file again")
    if element.name == "vertex":
        kinds = {p.kind for p in element.properties if p.name in "xyz"}
        if not {"x", "y", "z"} <= set(names) or len(kinds) != 1 or not kinds <= {"f4", "f8"}:
            raise ReadError("x, y and z of the vertices are not all float or all double", hint=ELSEWHERE)
        if set(NORMALS) & set(names):
            raise ReadError("the file has vertex normals, which are not recomputed in parts", hint=ELSEWHERE)
    return np.dtype(fields)


def _blocks(path: Path, table: Table) -> Iterator[tuple[int, NDArray[Any]]]:
    with path.open("rb") as file:
        file.seek(table.start)
        for first in range(0, table.rows, BLOCK):
            yield first, np.fromfile(file, table.kind, min(BLOCK, table.rows - first))


def _bytes(path: Path, start: int, end: int) -> Iterator[bytes]:
    with path.open("rb") as file:
        file.seek(start)
        while start < end and (piece := file.read(min(1 << 22, end - start))):
            start += len(piece)
            yield piece
