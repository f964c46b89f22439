"""STL: triangles with their own corners, binary or in text; welded inside."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import Content
from cascadenorm.io.polygons import Polygons, area_vectors, triangulate
from cascadenorm.io.spelling import spelled
from cascadenorm.io.text import Text
from cascadenorm.io.tokenizer import Places
from cascadenorm.mesh import unit

RECORD = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
HEADER = 84  # 80 bytes of anything, then the number of triangles


class StlFile(MeshFile):
    """An STL file; the header and the attribute bytes, or the names and the layout of the text, are kept.

    Positions are float32 in a binary file and float64 in a text.
    """

    format = "stl"

    def _parse(self) -> tuple[NDArray[Any], Polygons]:
        data = self.data
        self._text = Text(data) if _is_text(data) else None
        if self._text is None:
            count = int.from_bytes(data[80:HEADER], "little")
            if len(data) < HEADER + count * RECORD.itemsize:
                raise ReadError(
                    f"the STL header declares {count} triangles, but the file ends within number "
                    f"{max(len(data) - HEADER, 0) // RECORD.itemsize}: it is truncated, or not an STL file"
                )
            self._records = np.frombuffer(data, RECORD, count, HEADER)
            positions: NDArray[Any] = self._records["corners"].reshape(-1, 3).astype(np.float32)
        else:
            self._facets, vertices = _facets(self._text)
            self._words = self._text.columns(vertices, 3)
            positions = self._text.numbers(self._words)
        return positions, Polygons.from_rows(np.arange(len(positions)).reshape(-1, 3))

    def _moved_pieces(self) -> Iterable[Piece]:
        moved = self._changed.reshape(-1, 9).any(axis=1) & ~self.left_out
        normals = unit(area_vectors(self.positions, self.triangles[moved])).astype(np.float32)
        if self._text is None:
            records = self._records.copy()
            records["corners"] = self.positions.reshape(-1, 3, 3)
            records["normal"][moved] = normals
            end = HEADER + records.nbytes
            return [self.data[:HEADER], records.view(np.uint8).data, memoryview(self.data)[end:]]
        words, spellings = self._words[self._changed], spelled(self.positions[self._changed])
        text, facet_lines = self._text, self._facets
        if (text.stop[facet_lines] - text.first[facet_lines] >= 5).all():  # facet normal x y z
            words = np.concatenate([words, text.columns(facet_lines[moved], 3, start=2).ravel()])
            spellings = np.concatenate([spellings, spelled(normals)])
        return text.replaced(words, spellings)

    def _read_content(self) -> Content:
        positions = self.positions[self._weld[1]]
        polygons = Polygons.from_rows(self.welds[self.triangles].astype(np.int64))
        if self._text is not None:
            return Content(positions, polygons, left_out=("names of solids",))
        attribute = self._records["attribute"]
        values = {"attribute": attribute.astype(np.uint16)} if attribute.any() else {}
        return Content(positions, polygons, face_values=values, left_out=("the header",) if any(self.data[:80]) else ())

    @classmethod
    def encode(cls, content: Content) -> tuple[bytes, list[str]]:
        """Write content as binary STL."""
        triangles, owners = triangulate(content.positions, content.polygons)
        records = np.zeros(len(triangles), RECORD)
        single = content.single_positions()
        records["corners"] = single[triangles]
        records["normal"] = unit(area_vectors(content.positions, triangles))
        lost = [f"vertex property '{name}'" for name in content.vertex_values]
        lost += [f"face property '{name}'" for name in content.face_values if name != "attribute"]
        if "attribute" in content.face_values:
            records["attribute"] = content.face_values["attribute"][owners]
        if (content.polygons.counts != 3).any():
            lost.append("polygons (cut into triangles)")
        if (single != content.positions).any():
            lost.append("digits of the positions beyond single precision")
        lost.append("the order of the vertices")
        return b"".join([bytes(80), len(records).to_bytes(4, "little"), records.view(np.uint8).data]), lost


def is_binary_stl(data: bytes) -> bool:
    """Test by the length, since binary files too may begin with 'solid'."""
    return len(data) == HEADER + int.from_bytes(data[80:HEADER], "little") * RECORD.itemsize


def _is_text(data: bytes) -> bool:
    if is_binary_stl(data) or data.lstrip()[:5].lower() != b"solid":
        return False
    return any(word in data[:100_000].lower() for word in (b"facet", b"endsolid"))


def _facets(text: Text) -> tuple[Places, Places]:
    """Return the lines of facets and of their corners; raises ReadError where they do not go together."""
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
