"""Wavefront OBJ: replace the numbers of `v` and `vn` and keep all lines."""

import copy
import os
import re
from collections.abc import Iterable
from itertools import pairwise, takewhile
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import TEXTURE, Content, Labels, Look, from_words
from cascadenorm.io.hole_patches import HolePatches
from cascadenorm.io.sidecar_files import content_beside, file_beside
from cascadenorm.io.text.number_format import lines_of, replace_words, rows_of
from cascadenorm.io.text.text import Text, blocks
from cascadenorm.io.text.tokenizer import Offsets
from cascadenorm.mesh import Bools
from cascadenorm.mesh.normals import Normals
from cascadenorm.mesh.polygons import Polygons, ranges

KEPT_ELSEWHERE = {
    "vn": "normals",
    "vt": "texture coordinates",
    "usemtl": "materials",
    "g": "groups",
    "o": "object names",
    "s": "smoothing groups",
    "l": "lines",
    "p": "points",
}
STATES = (b"o", b"g", b"usemtl", b"s")  # states that apply to all following faces
REST_OF_LINE = re.compile(rb"(?:\\(?:\r\n|\r|\n)|[^\r\n])*")
LINE_END = re.compile(rb"\\[\r\n]+")  # a backslash continues the line
LABEL_KEYWORDS = {"usemtl": "material", "o": "object", "g": "group"}


class ObjFile(MeshFile):
    """An OBJ file. Everything but positions and normals is kept; new normals keep creases. Positions are float64."""

    format = "obj"
    counts_from = 1

    def _parse(self) -> tuple[NDArray[np.float64], Polygons]:
        self._text = text = Text(self.data, continued=True)
        self._vertices = text.lines_with(b"v")
        self._words = text.columns(self._vertices, 3)
        self._faces = np.sort(np.concatenate([text.lines_with(b"f"), text.lines_with(b"fo")]))
        if not len(self._vertices) and not len(self._faces):
            raise ReadError("no line begins with v or f: this is not an OBJ file")
        counts = (text.stop - text.first)[self._faces] - 1
        self._corners = ranges(text.first[self._faces] + 1, counts).astype(text.starts.dtype)
        slashes = np.flatnonzero(text.bytes == ord("/"))
        self._slashes = np.append(slashes, [len(self.data)] * 3).astype(text.starts.dtype) if len(slashes) else slashes
        corners = self._references(0, self._vertices)
        return text.numbers(self._words), Polygons.from_counts(counts, corners)

    def _references(self, field: int, lines: Offsets) -> NDArray[np.int64]:
        """Return the index in a field (of v/vt/vn) of each corner, counted from 0 among the lines; -1 if empty."""
        if field and not len(self._slashes):
            return np.full(len(self._corners), -1)
        numbers = np.zeros(len(self._corners), np.int64)
        for block in blocks(len(numbers)):
            starts, ends = self._field(field, self._corners[block])
            given = ends > starts if field else np.ones(len(starts), bool)
            numbers[block][given] = self._text.integers_at(starts[given], ends[given])
        counted_back = numbers < 0
        if counted_back.any():
            before = np.searchsorted(self._text.first[lines], self._corners[counted_back])
            numbers[counted_back] = np.maximum(numbers[counted_back] + before, -1)
        numbers[~counted_back] -= 1
        return numbers

    def _field(self, field: int, words: Offsets) -> tuple[Offsets, Offsets]:
        """Return where a field of words begins and ends. It may be empty."""
        starts, ends = self._text.starts[words], self._text.ends[words]
        if not len(self._slashes):
            return starts, ends
        next_slash = np.searchsorted(self._slashes, starts)
        borders = np.stack([starts - 1, *(np.minimum(self._slashes[next_slash + i], ends) for i in range(3))])
        return np.minimum(borders[field] + 1, ends), borders[field + 1]

    def _moved_pieces(self) -> Iterable[Piece]:
        text = self._text
        replaced = [(self._words[self._changed], self.positions[self._changed])]
        lines = text.lines_with(b"vn")
        if len(lines) and (text.stop[lines] - text.first[lines]).min() > 3:
            columns = text.columns(lines, 3)
            stored = text.numbers(columns, lax=True)
            named = self._references(2, lines)
            named[named >= len(lines)] = -1
            normals, renewed = self._renewed(Normals(stored, self._at_triangles(named)))
            replaced.append((columns[renewed].ravel(), normals[renewed].astype(np.float32).ravel()))
        return replace_words(text, *replaced)

    def with_patches(self, patches: HolePatches) -> "ObjFile":
        """Return this file with additional vertices and triangles at its end. Existing bytes are kept.

        Colours are interpolated from the surroundings. A triangle has the object, group, material and smoothing group
        of the nearest face, but no texture coordinates and no normals.
        """
        rows = [b"v " + row for row in rows_of(patches.positions)]
        width = (self._text.stop - self._text.first)[self._vertices] - 1
        if width.min() > 3:
            words = self._text.columns(self._vertices, int(width.min()) - 3, start=4)
            stored = self._text.numbers(words)
            whole = (stored >= 2).any() and (stored == np.rint(stored)).all()
            values = np.stack([patches.blended(column) for column in stored.T], axis=1)
            texts = rows_of(np.rint(values).astype(np.int64) if whole else values.astype(np.float32))
            rows = [row + b" " + more for row, more in zip(rows, texts, strict=True)]
        lines = [self._text.lines_with(keyword) for keyword in STATES]
        now = [len(of) - 1 for of in lines]  # the last line of each keyword
        states = np.stack([np.searchsorted(of, self._faces[patches.polygons]) - 1 for of in lines], axis=1)
        for row in np.lexsort(states.T[::-1]).tolist():
            for place, of in enumerate(lines):
                wanted = int(states[row, place])
                if wanted != now[place] and wanted >= 0:
                    rows.append(b" ".join(self._line(int(of[wanted]))))
                    now[place] = wanted
            rows.append(b"f %d %d %d" % tuple((patches.triangles[row] + 1).tolist()))
        glue = b"" if self.data.endswith((b"\n", b"\r")) and not self.data.rstrip().endswith(b"\\") else b"\n"
        return ObjFile(self.data + glue + b"\n".join(rows) + b"\n", self.folder)

    def without(self, polygons: Bools, vertices: Bools) -> "ObjFile | None":
        """Return this file without the lines of some polygons, and of some vertices that only these polygons use.

        Returns None if vertices are used in another way: by lines, points, free-form surfaces or faces that reference
        vertices that do not exist.
        """
        text, missing = self._text, self.polygons.out_of_range(len(self.positions))
        if missing.any() or any(len(text.lines_with(keyword)) for keyword in (b"l", b"p", b"cstype")):
            return None
        kept = ~polygons[self.polygons.owners]
        fields = copy.copy(text)
        fields.starts, fields.ends = self._field(0, self._corners[kept])
        numbers = np.cumsum(~vertices)[self.polygons.corners[kept]]  # counted from 1
        data = b"".join(replace_words(fields, (np.arange(len(numbers)), numbers)))
        lines = np.sort(np.concatenate([self._faces[polygons], self._vertices[vertices]]))
        file = ObjFile(Text(data, continued=True).without_lines(lines), self.folder)
        file.mark = self.mark
        return file

    def _line(self, line: int) -> list[bytes]:
        """Return the words of a line with a keyword. Names may contain #, which begins a comment in other lines."""
        keyword = self._text.first[line]
        rest = REST_OF_LINE.match(self.data, int(self._text.ends[keyword]))
        assert rest is not None  # it may be empty
        return [self._text.word(keyword), *LINE_END.sub(b" ", rest[0]).split()]

    def refers_to(self) -> dict[str, bool]:
        """Return the names of material libraries and of their textures."""
        text, names = self._text, list[str]()
        for line in text.lines_with(b"mtllib"):
            first, last = text.first[line] + 1, text.stop[line] - 1
            if first > last:
                continue
            words = self.data[text.starts[first] : text.ends[last]].replace(b"\\", b"/")
            for name in self._libraries(os.fsdecode(words)):
                names.append(name)
                names += textures(content_beside(self.folder, name) or b"", name)
        return dict.fromkeys(names, False)

    def _libraries(self, names: str) -> list[str]:
        """Split the names of a line. A name may contain spaces or be followed by another one."""
        apart = names.split()
        together = file_beside(self.folder, names) is not None
        return apart if not together and all(file_beside(self.folder, name) for name in apart) else [names]

    def _read_content(self) -> Content:
        text = self._text
        width = (text.stop - text.first)[self._vertices] - 1
        has_colors = len(width) > 0 and width.min() >= 6
        colors = from_words(text, text.columns(self._vertices, 3, start=4)) if has_colors else {}
        textured = self._texture()
        left_out = [what for key, what in KEPT_ELSEWHERE.items() if len(text.lines_with(key.encode()))]
        if textured:
            left_out.remove("texture coordinates")
        if width.max(initial=0) > (6 if has_colors else 3):
            left_out.append("further numbers of vertices, such as weights, or colours that some lack")
        if b"#" in self.data:
            left_out.append("comments")
        return Content(self.positions, self.polygons, {**colors, **textured}, {}, tuple(left_out))

    def _texture(self) -> dict[str, NDArray[np.float64]]:
        """Return the texture coordinates of the positions, if each has only one."""
        lines = self._text.lines_with(b"vt")
        named = self._references(1, lines)
        if not len(lines) or (named < 0).any() or (named >= len(lines)).any():
            return {}
        owners, missing = self.polygons.owners, self.polygons.out_of_range(len(self.positions))
        exist = ~np.isin(owners, owners[missing]) if missing.any() else ~missing  # other formats omit such faces
        corners, named = self.polygons.corners[exist], named[exist]
        of_position = np.full(len(self.positions), -1)
        of_position[corners] = named
        if (of_position[corners] != named).any():
            return {}
        found = self._text.numbers(self._text.columns(lines, 2))
        used = np.where(of_position[:, None] >= 0, found[of_position], 0)
        return dict(zip(TEXTURE, used.T, strict=True))

    def face_labels(self) -> list[Labels]:
        """Return materials, objects and groups. A face in several groups has a label for each."""
        labels = []
        for keyword, kind in LABEL_KEYWORDS.items():
            lines = self._text.lines_with(keyword.encode())
            named = [[word.decode("utf-8", "replace") for word in self._line(line)[1:]] for line in lines.tolist()]
            if kind == "group":  # several names, and then perhaps a comment
                rows = [list(takewhile(lambda word: word != "#", words)) for words in named]
            else:
                rows = [[" ".join(words)] for words in named]
            of_faces = np.searchsorted(lines, self._faces) - 1  # the last such line before each face
            for place in range(max(map(len, rows), default=0)):
                values = np.array([words[place] if place < len(words) else "" for words in rows])
                labels.append(Labels(kind, values, np.where(values[of_faces] == "", -1, of_faces)))
        return labels

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write content as OBJ, with the colours and texture coordinates of vertices."""
        colors, texture, names = Look.of(content.vertex_values)
        text = [lines_of(b"v", content.positions, *([] if colors is None else [colors]))]
        if texture is not None:
            text.append(lines_of(b"vt", texture))
        return [*text, *_face_lines(content.polygons, texture is not None)], content.lost_values(names)


def _face_lines(polygons: Polygons, textured: bool) -> list[bytes]:
    """Format the corners of each face, counted from 1. If textured, each corner has the same texture index."""
    corners, counts = polygons.corners + 1, polygons.counts
    if len(counts) and (counts == counts[0]).all() and not textured:
        return [lines_of(b"f", corners.reshape(len(counts), counts[0]))]
    words = rows_of(corners[:, None])
    if textured:
        words = [b"%b/%b" % (word, word) for word in words]
    return [b"f %b\n" % b" ".join(words[a:b]) for a, b in pairwise(polygons.indptr.tolist())]


OPTION = rb"-\w+(?:[ \t]+(?:on|off|[rgbmlz]|sphere|cube_\w+|[-+]?[\d.]+))*[ \t]+"
KEYWORD = rb"^[ \t]*(?:map_\w+|bump|disp|decal|refl|norm)[ \t]+"
TEXTURE_LINE = re.compile(KEYWORD + rb"(?:" + OPTION + rb")*([^\r\n]*\S)", re.M | re.I)


def textures(library: bytes, name: str) -> list[str]:
    """Return the names of textures, relative to the same folder as the name of the library."""
    found = {os.fsdecode(match[1]).replace("\\", "/") for match in TEXTURE_LINE.finditer(library)}
    return sorted((PurePath(name).parent / texture).as_posix() for texture in found)
