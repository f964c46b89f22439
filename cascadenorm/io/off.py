"""OFF in text with any of the prefixes ST, C, N and 4: lines of vertices, then of polygons."""

import re
from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError, counted
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import Content, channels, from_words
from cascadenorm.io.text.number_format import lines_of, replace_words, rows_of
from cascadenorm.io.text.text import Text, shown
from cascadenorm.io.text.tokenizer import Offsets
from cascadenorm.mesh.normals import Normals
from cascadenorm.mesh.polygons import Polygons, ranges

OFF_HEADER = re.compile(rb"(?:\s|#[^\r\n]*(?:[\r\n]|\Z))*((?:ST|C|N)*4?n?OFF|off)(?=[\s\d#]|\Z)")


class OffFile(MeshFile):
    """An OFF file. Comments, colours and additional columns are kept. Positions are float64."""

    format = "off"

    def _parse(self) -> tuple[NDArray[np.float64], Polygons]:
        data = self.data
        magic = OFF_HEADER.match(data)
        self._flavour = magic[1].decode() if magic else "OFF"
        header = data[magic.end() : magic.end() + 40] if magic else b""
        if "n" in self._flavour or b"BINARY" in header.split(b"\n")[0].split(b"#")[0]:
            raise ReadError("this variant of OFF (binary, or not in 3 dimensions) cannot be read: export it as PLY")
        self._text = text = Text(data, start=magic.end() if magic else 0)
        lines = np.arange(len(text.first))
        if not len(lines):
            raise ReadError("the OFF file has no line with the counts of vertices and faces: it is empty or truncated")
        if text.stop[0] - text.first[0] < 2:
            raise ReadError(
                f"line {text.line_number(text.starts[0])} has {shown(text.word(0))} instead of the counts of vertices "
                "and faces: the file is truncated there, or damaged; get a complete copy"
            )
        vertex_count, face_count = text.integers(text.columns(lines[:1], 2, start=0)[0]).tolist()
        if min(vertex_count, face_count) < 0 or vertex_count + face_count > len(lines) - 1:
            raise ReadError(
                f"the OFF header declares {counted(vertex_count, 'vertex', 'vertices')} and "
                f"{counted(face_count, 'face')}, a line each, but only "
                f"{counted(len(lines) - 1, 'line follows', 'lines follow')}: the file is truncated, or its header is "
                "wrong; get a complete copy"
            )
        self._vertices, self._faces = np.split(lines[1 : 1 + vertex_count + face_count], [vertex_count])
        self._words = text.columns(self._vertices, 3, start=0)
        return text.numbers(self._words), self._read_polygons()

    def _read_polygons(self) -> Polygons:
        text = self._text
        counts = text.integers(text.columns(self._faces, 1, start=0)[:, 0])
        negative = np.flatnonzero(counts < 0)
        if len(negative):
            line = text.line_number(text.starts[text.first[self._faces[negative[0]]]])
            raise ReadError(
                f"line {line}: a face has {counts[negative[0]]} vertices: the file is damaged; get a complete copy"
            )
        text.require(self._faces, counts + 1)
        return Polygons.from_counts(counts, text.integers(ranges(text.first[self._faces] + 1, counts)))

    def _moved_pieces(self) -> Iterable[Piece]:
        replaced = [(self._words[self._changed], self.positions[self._changed])]
        if "N" in self._flavour:
            columns, stored = self._normals(4 * self._colors_first())
            normals, renewed = self._renewed(Normals(stored, self.triangles))
            replaced.append((columns[renewed].ravel(), normals[renewed].astype(np.float32).ravel()))
        return replace_words(self._text, *replaced)

    def _normals(self, skipped: int = 0) -> tuple[Offsets, NDArray[np.float64]]:
        """Return the words of the normals, which follow the positions and some skipped words, and their numbers."""
        columns = self._text.columns(self._vertices, 3, start=3 + ("4" in self._flavour) + skipped)
        return columns, self._text.numbers(columns, lax=True)

    def _colors_first(self) -> bool:
        """Whether four channels of colours precede the normals, as in NCOFF files of VCG but not in those of Open3D."""
        if "NC" not in self._flavour or not len(self._vertices):
            return False
        return bool(np.isclose(np.linalg.norm(self._normals()[1], axis=1), 1, atol=0.01).mean() < 0.5)

    def _read_content(self) -> Content:
        counts, normals, colors_first = self.polygons.counts, 3 * ("N" in self._flavour), self._colors_first()
        skipped = 3 + ("4" in self._flavour) + normals * (not colors_first)
        after = 2 * ("ST" in self._flavour) + normals * colors_first  # texture coordinates come last
        colors = self._colors(self._vertices, np.full(len(self._vertices), skipped), after=after)
        face_colors = self._colors(self._faces, 1 + counts)
        further = (self._text.stop - self._text.first)[self._faces] > 1 + counts
        left_out = {
            "comments": b"#" in self.data,
            "normals": "N" in self._flavour,
            "texture coordinates": "ST" in self._flavour,
            "colours that only some faces have, or that a colour map defines": further.any() and not face_colors,
        }
        lost = tuple(what for what, is_so in left_out.items() if is_so)
        return Content(self.positions, self.polygons, colors, face_colors, lost)

    def _colors(self, lines: Offsets, skipped: Offsets, *, after: int = 0) -> dict[str, NDArray[np.uint8]]:
        """Return the channels after the skipped words, if each line has three or more before the last `after` words."""
        further = self._text.stop[lines] - self._text.first[lines] - skipped - after
        if not len(lines) or further.min() < 3:
            return {}
        words = (self._text.first[lines] + skipped)[:, None] + np.arange(min(int(further.min()), 4))
        return from_words(self._text, words)

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write content as OFF in text, with the colours of vertices (COFF) and of faces."""
        colors, face_colors = channels(content.vertex_values), channels(content.face_values)
        header = b"%b\n%d %d 0\n" % (b"COFF" if colors else b"OFF", len(content.positions), len(content.polygons))
        vertices = lines_of(b"", content.positions, *_table(colors))
        faces = _face_lines(content.polygons, _table(face_colors))
        return [header, vertices, *faces], content.lost_values(colors, face_colors)


def _table(colors: dict[str, NDArray[np.uint8]]) -> list[NDArray[np.uint8]]:
    """Put channels side by side, if there are any."""
    return [np.stack(list(colors.values()), axis=1)] if colors else []


def _face_lines(polygons: Polygons, colors: list[NDArray[np.uint8]]) -> list[bytes]:
    """Format the number of corners of each face, the corners, and the colours, if there are any."""
    counts = polygons.counts
    if len(counts) and (counts == counts[0]).all():
        return [lines_of(b"%d" % counts[0], polygons.corners.reshape(len(counts), counts[0]), *colors)]
    words = rows_of(polygons.corners[:, None])
    ends = [b" " + row for row in rows_of(colors[0])] if colors else [b""] * len(counts)
    pairs = zip(pairwise(polygons.indptr.tolist()), ends, strict=True)
    return [b"%d %b%b\n" % (b - a, b" ".join(words[a:b]), end) for (a, b), end in pairs]
