"""PLY in text or binary of either byte order. All elements, properties and comments are kept."""

import os
import re
from collections.abc import Iterable
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import OutputError, ReadError
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import CHANNELS, Content, Positions
from cascadenorm.io.hole_patches import HolePatches
from cascadenorm.io.ply.header import NAMES, PlyElement, PlyProperty, parse_header
from cascadenorm.io.ply.table import (
    Body,
    PropertyColumn,
    PropertyKind,
    binary_rows,
    columns,
    fields_of,
    joined_columns,
    list_rows,
    text_rows,
)
from cascadenorm.io.text.number_format import replace_words
from cascadenorm.io.text.text import Text, as_short, edited
from cascadenorm.io.text.tokenizer import splice
from cascadenorm.mesh import marked
from cascadenorm.mesh.normals import Normals
from cascadenorm.mesh.polygons import Polygons, strips

XYZ, NORMAL = ("x", "y", "z"), ("nx", "ny", "nz")
CORNERS = ("vertex_indices", "vertex_index")
WORD = 8  # bytes for each number of a text body

Replaced = tuple[PropertyColumn, NDArray[Any], NDArray[np.bool_]]
"""A column, its values, and which of them to replace."""


class PlyFile(MeshFile):
    """A PLY file. Positions are float32 if stored as float, and float64 if stored as double or integers."""

    format = "ply"

    def _parse(self) -> tuple[NDArray[Any], Polygons]:
        data = self.data
        self.header = header = parse_header(data)
        self._text = None if header.byte_order else Text(data, start=header.length)
        self._body: Body = data
        if self._text is not None:
            numbers = self._text.numbers_at(self._text.starts, self._text.ends)
            self._body = numbers.astype("<f8", copy=False).view(np.uint8).data
        self._columns: dict[tuple[str, str], PropertyColumn] = {}
        self._ends: dict[str, int] = {}
        start = header.length if header.byte_order else 0
        wrong: ReadError | None = None
        for element in header.elements:
            kinds = [_kind(p, header.byte_order) for p in element.properties]
            try:
                found, stop = columns(self._body, element, start, kinds)
            except ReadError as error:
                raise wrong or self._long_line(element, start) or error from None
            wrong = wrong or self._row_within_line(element, found)
            self._ends[element.name] = start = stop
            for p, column in zip(element.properties, found, strict=True):
                self._columns.setdefault((element.name, p.name), column)
        if wrong is not None and start < len(self._body):
            raise wrong
        return self._positions(), self._polygons()

    def _row_within_line(self, element: PlyElement, found: list[PropertyColumn]) -> ReadError | None:
        """Return an error about the line before the first row that does not start a line of the text, or None.

        Rows may have any layout. But if numbers are left over at the end of the file, that line has too many.
        """
        if self._text is None or not found or not len(found[0].offsets):
            return None
        first, text = element.properties[0], self._text
        begins = np.asarray(found[0].offsets) // WORD - (first.count_kind is not None)
        begins_line = marked(text.first, len(text.starts))
        rows = np.flatnonzero(~begins_line[begins])
        if not len(rows):
            return None
        return _too_long(text, int(np.searchsorted(text.first, begins[rows[0]], "right")) - 1, element)

    def _long_line(self, element: PlyElement, start: int) -> ReadError | None:
        """Return an error about the first line with more numbers than a row, or None if rows do not match lines."""
        if self._text is None:
            return None
        text, numbers = self._text, np.frombuffer(self._body)
        first = int(np.searchsorted(text.first, start // WORD))
        for line in range(first, min(first + element.rows, len(text.first))):
            at, stop = int(text.first[line]), int(text.stop[line])
            for p in element.properties:
                if at >= stop or (p.count_kind and not 0 <= numbers[at] < stop - at):
                    return None
                at += 1 + (int(numbers[at]) if p.count_kind else 0)
            if at < stop:
                return _too_long(text, line, element)
        return None

    @property
    def _coordinate_kinds(self) -> list[str]:
        """The types of x, y and z that the header declares."""
        return [self._columns["vertex", name].declared.kind for name in XYZ]

    def _read(self, element: str, names: tuple[str, ...]) -> NDArray[Any] | None:
        """Return the values of single-number properties side by side, or None if the file lacks one."""
        found = [self._columns[element, name] for name in names if (element, name) in self._columns]
        if len(found) < len(names) or any(column.declared.count_kind is not None for column in found):
            return None
        return np.stack([column.read(self._body) for column in found], axis=1)

    def _normal_kind(self, element: str) -> np.dtype[Any]:
        return np.dtype(self._columns[element, NORMAL[0]].declared.kind)

    def _positions(self) -> NDArray[Any]:
        values = self._read("vertex", XYZ)
        if values is None:
            raise ReadError("the PLY header has no element 'vertex' with the properties x, y and z: this is not a mesh")
        single = set(self._coordinate_kinds) == {"f4"}
        if self._text is not None and single:  # a text may have more digits than its header declares
            words = np.concatenate([np.asarray(self._columns["vertex", name].offsets) // WORD for name in XYZ])
            return as_short(values.astype(np.float64), self._text.significant_digits(words))
        return values.astype(np.float32 if single else np.float64)

    def _storable(self, positions: Positions) -> Positions:
        """Round the coordinates that the file stores in single precision next to double ones."""
        single = [kind == "f4" for kind in self._coordinate_kinds]
        if positions.dtype == np.float32 or self._text is not None or not any(single):
            return positions
        return np.where(single, positions.astype(np.float32), positions)

    def _polygons(self) -> Polygons:
        for name in CORNERS:
            for element, made in (("face", Polygons.from_counts), ("tristrips", strips)):
                column = self._columns.get((element, name))
                if column is not None and (len(column.offsets) or element == "tristrips"):
                    counts = np.broadcast_to(np.asarray(column.counts, np.int64), len(column.offsets))
                    return made(counts, _whole(column.read(self._body)))
        return Polygons.from_rows(np.zeros((0, 3), np.int64))

    def _moved_pieces(self) -> Iterable[Piece]:
        if any(kind[0] != "f" for kind in self._coordinate_kinds):
            wider = PlyFile(self._widened())
            wider.positions = self.positions
            return wider.pieces()
        coordinates = [self._columns["vertex", name] for name in XYZ]
        replaced: list[Replaced] = list(zip(coordinates, self.positions.T, self._changed.T, strict=True))
        of_faces = np.broadcast_to(self.triangle_polygons[:, None], self.triangles.shape)
        corners = {"vertex": self.triangles, "face": of_faces}
        for element, used in corners.items():
            values = self._read(element, NORMAL)
            if values is None:
                continue
            kind = self._normal_kind(element)
            if kind.kind == "u":  # what stands for 0 is not known
                continue
            normals, renewed = self._renewed(Normals(values, used))
            if kind.kind == "i":
                normals = np.rint(normals * _lengths(values, kind))
            replaced += [(self._columns[element, n], v, renewed) for n, v in zip(NORMAL, normals.T, strict=True)]
        if self._text is not None:
            return replace_words(self._text, *map(_replaced_words, replaced))
        body = np.frombuffer(self._body, np.uint8).copy()
        for column, values, chosen in replaced:
            column.put(body, values, chosen)
        return [body.data]

    def _widened(self) -> bytes:
        """Return the file with integer positions converted to double."""
        parts = []  # offsets, sizes and new bytes
        for name in XYZ:
            column = self._columns["vertex", name]
            if column.declared.kind[0] == "f":
                continue
            begin, stop = column.declared.place
            parts.append((np.array([begin]), stop - begin, np.array([b"double"], "S8")))
            if self._text is None:
                doubles = column.read(self._body).astype(self.header.byte_order + "f8")
                parts.append((column.places(), column.kind.itemsize, doubles.view("S8")))
        place = np.concatenate([places for places, _, _ in parts])
        order = np.argsort(place)
        end = (place + np.concatenate([np.full(len(places), size) for places, size, _ in parts]))[order]
        letters = np.concatenate([new for _, _, new in parts])[order].view(np.uint8)
        begins = np.arange(0, len(letters), 8)
        stops = begins + np.where(end < self.header.length, len(b"double"), 8)
        out = np.empty(len(self.data) + len(letters), np.uint8)
        size = splice(np.frombuffer(self.data, np.uint8), place[order], end, letters, begins, stops, out)
        return out[:size].tobytes()

    def with_patches(self, patches: HolePatches) -> "PlyFile":
        """Return this file with additional vertices and triangles. Only the two row counts change in existing bytes.

        Vertex values are interpolated from the surrounding vertices if they are floating-point numbers or colours.
        Other vertex values, and face values, are those of the nearest vertex or face. Lists other than the corners are
        empty. Raises OutputError if the integer type of the vertex indices is too small for the additional vertices.
        """
        if any(kind[0] != "f" for kind in self._coordinate_kinds):
            return PlyFile(self._widened(), self.folder).with_patches(patches)
        header, inserted = self.data[: self.header.length], []
        end_of_line = next(end for end in (b"\r\n", b"\n", b"\r") if end in header)
        for element in self.header.elements:
            if element.name == "vertex":
                rows, values = len(patches.positions), self._patch_vertices(element, patches)
            elif element.name in ("face", "tristrips") and any(p.name in CORNERS for p in element.properties):
                rows, values = len(patches.triangles), self._patch_faces(element, patches)
            else:
                continue
            name = re.escape(element.name.encode())
            count = re.search(rb"[\r\n][ \t]*element[ \t]+" + name + rb"[ \t]+(\d+)", header)
            assert count is not None
            inserted.append((*count.span(1), b"%d" % (element.rows + rows)))
            if self._text is None:
                end, new = self._ends[element.name], binary_rows(element, values, self.header.byte_order)
            else:
                end = int(self._text.ends[self._ends[element.name] // WORD - 1])
                new = b"".join(end_of_line + row for row in text_rows(element, values))
            inserted.append((end, end, new))
        return PlyFile(b"".join(edited(self.data, sorted(inserted))), self.folder)

    def _patch_vertices(self, element: PlyElement, patches: HolePatches) -> list[NDArray[Any]]:
        """Return the values of additional vertices by property, (a, 1), or (a, 0) for a list."""
        own = dict(zip(XYZ, patches.positions.T, strict=True))
        normals = self._read("vertex", NORMAL)
        if normals is not None and (kind := self._normal_kind("vertex")).kind != "u":  # else the nearest are copied
            added = patches.all_normals(normals)[len(normals) :]
            if kind.kind == "i":
                added = added * patches.nearest(_lengths(normals, kind))
            own |= zip(NORMAL, added.T, strict=True)
        found = []
        for p in element.properties:
            values = np.zeros((len(patches.positions), 0))
            if p.count_kind is None:
                stored = self._columns["vertex", p.name].read(self._body)
                blends = p.kind[0] == "f" or p.name in CHANNELS
                one = own[p.name] if p.name in own else (patches.blended if blends else patches.nearest)(stored)
                values = (one if p.kind[0] == "f" else np.rint(one))[:, None]
            found.append(values)
        return found

    def _patch_faces(self, element: PlyElement, patches: HolePatches) -> list[NDArray[Any]]:
        """Return the values of additional faces by property: (b, 3) corners, (b, 1) numbers, (b, 0) for other lists."""
        count = len(patches.triangles)
        normals = self._read(element.name, NORMAL) if element.name == "face" else None
        own: dict[str, NDArray[Any]] = {}
        if normals is not None and (kind := self._normal_kind("face")).kind != "u":
            added = patches.face_normals(normals)
            if kind.kind == "i":
                added = np.rint(added * _lengths(normals, kind)[patches.polygons])
            own |= zip(NORMAL, added.T, strict=True)
        found = []
        for p in element.properties:
            values: NDArray[Any] = np.zeros((count, 0 if p.count_kind else 1))
            if p.name in CORNERS and p.count_kind:
                values = patches.triangles
                if p.kind[0] != "f" and patches.triangles.max(initial=0) > np.iinfo(p.kind).max:
                    raise OutputError(
                        f"the file stores vertex indices as {NAMES[p.kind]}, too small for the added vertices: "
                        "write another format, or convert the file first"
                    )
            elif p.count_kind is None and element.name == "face":
                stored = self._columns["face", p.name].read(self._body)
                values = own.get(p.name, stored[patches.polygons])[:, None]
            found.append(values)
        return found

    def refers_to(self) -> dict[str, bool]:
        """Return the names of textures that comments declare."""
        found = re.findall(rb"^comment[ \t]+TextureFile[ \t]+([^\r\n]*\S)", self.data[: self.header.length], re.M)
        return dict.fromkeys(map(os.fsdecode, found), False)

    def _read_content(self) -> Content:
        values: dict[str, dict[str, NDArray[Any]]] = {"vertex": {}, "face": {}}
        left_out = []
        for element in self.header.elements:
            for p in element.properties:
                known = (element.name == "vertex" and p.name in XYZ) or (element.name != "vertex" and p.name in CORNERS)
                if element.name in values and p.count_kind is None and not known:
                    with np.errstate(invalid="ignore"):  # a text may have larger numbers than its header declares
                        found = self._columns[element.name, p.name].read(self._body).astype(p.kind)
                    values[element.name][p.name] = found
                elif not known:
                    left_out.append(f"property '{p.name}' of '{element.name}'")
        if b"comment" in self.data[: self.header.length]:
            left_out.append("comments")
        return Content(self.positions, self.polygons, values["vertex"], values["face"], tuple(left_out))

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write content as binary little-endian PLY."""
        vertex = fields_of(dict(zip(XYZ, content.positions.T, strict=True))) | fields_of(content.vertex_values, XYZ)
        face, counts = fields_of(content.face_values, CORNERS), content.polygons.counts
        length = "u1" if counts.max(initial=0) < 256 else "<i4"
        lines = [
            *["ply", "format binary_little_endian 1.0", f"element vertex {len(content.positions)}"],
            *[f"property {NAMES[v.dtype.str[1:]]} {name}" for name, v in vertex.items()],
            *[f"element face {len(counts)}", f"property list {NAMES[length[-2:]]} int vertex_indices"],
            *[f"property {NAMES[v.dtype.str[1:]]} {name}" for name, v in face.items()],
            *["end_header", ""],
        ]
        vertex_rows = joined_columns(list(vertex.values()))
        return chain(["\n".join(lines).encode()], vertex_rows, list_rows(content.polygons, length, face)), []


class ArraysFile(MeshFile):
    """A binary PLY file of positions and polygons, encoded when its bytes are needed."""

    format = PlyFile.format
    encode = PlyFile.encode

    def __init__(self, positions: Positions, polygons: Polygons) -> None:
        self._read_positions, self.polygons = positions, polygons
        self.positions, self.parts, self.folder = positions, None, None

    @cached_property
    def data(self) -> bytes:  # type: ignore[override]  # read from a file in other formats
        """The bytes of the file before any vertex moved."""
        return b"".join(self.encode(Content(self._read_positions, self.polygons))[0])

    def _parse(self) -> tuple[Positions, Polygons]:
        return self._read_positions, self.polygons

    def pieces(self) -> Iterable[Piece]:
        """Return the bytes of the file with its current positions, in pieces."""
        return self.encode(self._read_content())[0]

    def _moved_pieces(self) -> Iterable[Piece]:
        return self.pieces()

    def content(self) -> Content:
        """Return the content that other formats can store."""
        return self._read_content()

    def _read_content(self) -> Content:
        return Content(self.positions, self.polygons)


def _replaced_words(replaced: Replaced) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the words of a text to replace, and the new numbers in the type in which they are formatted."""
    column, values, chosen = replaced
    single = column.declared.kind == "f4" and values.dtype != np.float64
    kind = np.int64 if column.declared.kind[0] != "f" else np.float32 if single else np.float64
    return np.asarray(column.offsets)[chosen] // WORD, values[chosen].astype(kind)


def _too_long(text: Text, line: int, element: PlyElement) -> ReadError:
    return ReadError(
        f"line {text.line_number(text.starts[text.first[line]])} has {text.stop[line] - text.first[line]} values, more "
        f"than the header declares for a row of {element.name!r}: correct the header, or export the file again"
    )


def _kind(p: PlyProperty, byte_order: str) -> PropertyKind:
    if not byte_order:
        number = np.dtype("<f8")
        return PropertyKind(number, None if p.count_kind is None else number)
    length = None if p.count_kind is None else np.dtype(byte_order + p.count_kind)
    return PropertyKind(np.dtype(byte_order + p.kind), length)


def _lengths(normals: NDArray[Any], kind: np.dtype[Any]) -> NDArray[np.float64]:
    """Return the (k, 1) lengths of normals of a signed integer type, which stand for 1."""
    lengths = np.linalg.norm(normals.astype(np.float64), axis=1, keepdims=True)
    return np.asarray(np.minimum(lengths, np.iinfo(kind).max))


def _whole(values: NDArray[Any]) -> NDArray[np.int64]:
    """Return vertex indices as integers. Raises ReadError if they are not integers."""
    if values.dtype.kind == "f":
        bad = ~((values == np.rint(values)) & (np.abs(values) < 2**53))
        if bad.any():
            raise ReadError(
                f"a face references vertex {values[bad][0]}, which is not a whole number: export the file again"
            )
    return values.astype(np.int64)
