"""STL in text and binary, with coincident corners welded."""

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError, counted
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import Content
from cascadenorm.io.text.number_format import replace_words
from cascadenorm.io.text.text import Text, blocks
from cascadenorm.io.text.tokenizer import Offsets
from cascadenorm.mesh import Bools, Floats32, any_in_rows, kernel, parallel_for
from cascadenorm.mesh.polygons import Polygons, largest_coordinate, triangulate, unit_normal, unit_normals
from cascadenorm.mesh.vectors import row

RECORD = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEADER = 84  # 80 arbitrary bytes, then the number of triangles


class StlFile(MeshFile):
    """An STL file: float32 with its header and attributes kept, or float64 in a text with its names and layout."""

    format = "stl"

    def _parse(self) -> tuple[NDArray[Any], Polygons]:
        data = self.data
        self._text = Text(data) if _is_text(data) else None
        if self._text is None:
            if len(data) < HEADER:
                raise ReadError(
                    f"the file has {counted(len(data), 'byte')}, fewer than the {HEADER} of a header, and no STL "
                    "text: it is truncated, or not an STL file"
                )
            count = int.from_bytes(data[80:HEADER], "little")
            if len(data) < HEADER + count * RECORD.itemsize:
                raise ReadError(
                    f"the STL header declares {count} triangles, but the file ends within number "
                    f"{max(len(data) - HEADER, 0) // RECORD.itemsize}: it is truncated, or not an STL file"
                )
            self._records = np.frombuffer(data, RECORD, count, HEADER)
            positions: NDArray[Any] = self._records["corners"].astype(np.float32).reshape(-1, 3)
        else:
            self._facets, vertices = _facets(self._text)
            self._words = self._text.columns(vertices, 3)
            positions = self._text.numbers(self._words)
        return positions, Polygons.from_rows(np.arange(len(positions)).reshape(-1, 3))

    def _moved_pieces(self) -> Iterable[Piece]:
        if self._text is None:
            end = HEADER + self._records.nbytes
            return chain([self.data[:HEADER]], self._moved_records(), [memoryview(self.data)[end:]])
        moved = any_in_rows(self._changed.reshape(-1, 9)) & ~self.left_out
        replaced = [(self._words[self._changed], self.positions[self._changed])]
        text, facet_lines = self._text, self._facets
        if (text.stop[facet_lines] - text.first[facet_lines] >= 5).all():  # facet normal x y z
            normals = unit_normals(self.positions, self.triangles[moved], largest_coordinate(self.positions))
            replaced.append((text.columns(facet_lines[moved], 3, start=2).ravel(), normals.ravel()))
        return replace_words(text, *replaced)

    def _moved_records(self) -> Iterator[Piece]:
        """Yield the records with the current positions, and new normals where these moved, block by block."""
        before, after = (positions.reshape(-1, 3, 3) for positions in (self._read_positions, self.positions))
        largest = largest_coordinate(after)
        for block in blocks(len(after), 12):
            records = np.empty_like(self._records[block])
            arrays = self._records[block], before[block], after[block], self.left_out[block]
            parallel_for(len(records), _move_range, *arrays, largest, records)
            yield records.view(np.uint8).data

    def _read_content(self) -> Content:
        positions = self.at_vertices(self.positions)
        polygons = Polygons.from_rows(self.welds[self.triangles].astype(np.int64))
        if self._text is not None:
            return Content(positions, polygons, left_out=("names of solids",))
        attribute = self._records["attribute"]
        values = {"attribute": attribute.astype(np.uint16)} if attribute.any() else {}
        return Content(positions, polygons, face_values=values, left_out=("the header",) if any(self.data[:80]) else ())

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write content as binary STL."""
        triangles, owners = triangulate(content.positions, content.polygons)
        single = content.single_positions()
        values = content.face_values.get("attribute", np.zeros(len(content.polygons), np.uint16))
        with np.errstate(invalid="ignore"):
            attribute = values.astype(np.uint16)
        fits = np.array_equal(attribute, values)
        attribute = attribute if fits else np.zeros_like(attribute)
        header = bytes(80) + len(triangles).to_bytes(4, "little")
        lost = content.lost_as_triangles(of_faces=["attribute"] if fits else [])
        lost.append("the order of the vertices")
        largest = largest_coordinate(content.positions)

        def records(block: slice) -> Piece:
            facets = np.empty(len(triangles[block]), RECORD)
            facets["normal"] = unit_normals(content.positions, triangles[block], largest)
            facets["corners"] = single.take(triangles[block], axis=0)
            facets["attribute"] = attribute[owners[block]]
            return facets.view(np.uint8).data

        return chain([header], map(records, blocks(len(triangles), 12))), lost


@kernel
def _move_range(
    start: int, stop: int, read: Any, before: Floats32, after: Floats32, left_out: Bools, largest: float, out: Any
) -> None:
    """Copy records with other corners, (m, 3, 3), and new normals where a corner has moved and the face is valid."""
    for f in range(start, stop):
        out[f] = read[f]
        moved = False
        for corner in range(3):
            for axis in range(3):
                moved |= after[f, corner, axis] != before[f, corner, axis] and not np.isnan(before[f, corner, axis])
                out[f]["corners"][corner, axis] = after[f, corner, axis]
        if moved and not left_out[f]:
            a, b, c = row(after[f], 0), row(after[f], 1), row(after[f], 2)
            normal = unit_normal(a, b, c, largest)
            for axis in range(3):
                out[f]["normal"][axis] = normal[axis]


def is_binary_stl(data: bytes) -> bool:
    """Test by length, since binary files may also begin with 'solid'."""
    return len(data) == HEADER + int.from_bytes(data[80:HEADER], "little") * RECORD.itemsize


def _is_text(data: bytes) -> bool:
    """Test for the words of a text, without enough records for the declared number and null bytes among them."""
    size = int.from_bytes(data[80:HEADER], "little") * RECORD.itemsize
    has_records = 0 < size <= len(data) - HEADER and b"\0" in data[: HEADER + RECORD.itemsize]
    if is_binary_stl(data) or has_records or data.lstrip()[:5].lower() != b"solid":
        return False
    return any(word in data[:100_000].lower() for word in (b"facet", b"endsolid"))


def _facets(text: Text) -> tuple[Offsets, Offsets]:
    """Return the lines of facets and of their corners. Raises ReadError if they do not match."""
    facets, vertices = text.lines_with(b"facet"), text.lines_with(b"vertex")
    ends, solids, solid_ends = (text.lines_with(word) for word in (b"endfacet", b"solid", b"endsolid"))
    if len(ends) != len(facets) or len(solid_ends) != len(solids):
        raise ReadError(
            f"the STL text has {len(facets)} 'facet' and {len(ends)} 'endfacet', {len(solids)} 'solid' and "
            f"{len(solid_ends)} 'endsolid': it is truncated; get a complete copy"
        )
    corners = np.bincount(np.searchsorted(facets, vertices, "right"), minlength=len(facets) + 1)
    wrong = vertices[:1] if corners[0] else facets[corners[1:] != 3]
    if len(wrong):
        line = text.line_number(text.starts[text.first[wrong[0]]])
        what = "this vertex is outside any facet" if corners[0] else "this facet does not have three vertices"
        raise ReadError(f"line {line}: {what}: the file is damaged; get a complete copy")
    return facets, vertices
