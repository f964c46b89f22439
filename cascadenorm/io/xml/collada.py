"""COLLADA: replace coordinates and normals, as they are before the transforms of nodes, and keep all else."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from html import unescape
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import CHANNELS, TEXTURE, Content, Labels, Look, as_bytes
from cascadenorm.io.limits import check_expansion
from cascadenorm.io.shown import joined, placed, placements, values_of_vertices
from cascadenorm.io.sidecar_files import relative_name
from cascadenorm.io.text.number_format import lines_of, replace_words
from cascadenorm.io.text.text import Edit, Text, as_short, edited
from cascadenorm.io.xml.collada_nodes import instances
from cascadenorm.io.xml.documents import Element, tree_of
from cascadenorm.mesh import repeats_vertex
from cascadenorm.mesh.polygons import Polygons, fans, strips

KINDS = ("triangles", "polylist", "polygons", "tristrips", "trifans")
LINES = ("lines", "linestrips")
CONVERTED = {"COLOR": CHANNELS, "TEXCOORD": TEXTURE}  # names of the values of vertices by their semantic
SEMANTICS = {"COLOR": "colours", "TEXCOORD": "texture coordinates", "NORMAL": "normals"}  # semantics in words
FURTHER = "further "  # prefix of the second set of values of a semantic
KEPT_ELSEWHERE = {
    "library_materials": "materials",
    "library_images": "textures",
    "library_animations": "animations",
    "library_controllers": "skins and morph targets",
    "library_cameras": "cameras",
}


class SourceArray:
    """The vectors of a source: their `words` in the `text` of the array, (k, w), and `values`, (k, w) float64.

    `begin` and `end` are the position of the text in the document.
    """

    def __init__(self, source: Element, by_id: dict[str, Element]) -> None:
        accessor = source.first("technique_common", "accessor")
        found = by_id.get(accessor.attributes.get("source", "").removeprefix("#")) if accessor is not None else None
        if accessor is None or found is None or found.name != "float_array":
            raise ReadError(
                f"the source {source.attributes.get('id', '')!r} of this COLLADA file has no array of numbers"
            )
        self.begin, self.end = found.span
        self.text = Text(found.numbers)
        defaults = {"count": "0", "stride": "1", "offset": "0"}
        count, stride, offset = (_number(accessor.attributes.get(*default)) for default in defaults.items())
        named = [row for row, parameter in enumerate(accessor.all("param")) if parameter.attributes.get("name")]
        width = named or list(range(min(stride, 3)))
        last = offset + (count - 1) * stride + max(width, default=0)
        if not width or stride < 1 or (count and last >= len(self.text.starts)):
            raise ReadError(f"the source {source.attributes.get('id', '')!r} announces more numbers than it holds")
        self.words = offset + stride * np.arange(count)[:, None] + np.array(width)
        self.values = self.text.numbers(self.words)


class Part(NamedTuple):
    """Faces of a geometry that share a material."""

    geometry: str  # id of the geometry
    material: str  # symbol of the material
    positions: str  # id of the source of the positions
    # Faces. Corners are rows of the positions.
    polygons: Polygons
    # Semantic -> id of another source, such as that of normals, and its row for each corner
    others: dict[str, tuple[str, NDArray[np.int64]]]


class ColladaFile(MeshFile):
    """A COLLADA file. Positions are float32 if that holds all their digits, otherwise float64."""

    format = "dae"

    def _parse(self) -> tuple[NDArray[Any], Polygons]:
        self._root = tree_of(self.data)
        self._by_id = {id: element for element in self._root.within() if (id := element.attributes.get("id"))}
        self._arrays: dict[str, SourceArray] = {}
        self._parts = [part for geometry in self._root.within() for part in self._parts_of(geometry)]
        self._sources = list(dict.fromkeys(part.positions for part in self._parts))
        if not self._sources:
            raise ReadError("there is no mesh in this COLLADA file: export it again")
        arrays = [self._array(source) for source in self._sources]
        sizes = [len(array.values) for array in arrays]
        self._first = dict(zip(self._sources, np.cumsum([0, *sizes]).tolist(), strict=False))
        self.parts = np.repeat(np.arange(len(sizes)), sizes) if len(sizes) > 1 else None
        positions = np.concatenate([array.values for array in arrays])
        digits = max(array.text.significant_digits(array.words.ravel()) for array in arrays)
        places = [(self._first[part.positions], len(self._array(part.positions).values)) for part in self._parts]
        polygons = [part.polygons.moved_to(*place) for part, place in zip(self._parts, places, strict=True)]
        return as_short(positions, digits), Polygons.joined(polygons)

    def _array(self, id: str) -> SourceArray:
        if id not in self._arrays:
            source = self._by_id.get(id)
            if source is None or source.name != "source":
                raise ReadError(f"this COLLADA file has no source {id!r}: export it again")
            self._arrays[id] = SourceArray(source, self._by_id)
        return self._arrays[id]

    def _parts_of(self, geometry: Element) -> list[Part]:
        mesh = geometry.first("mesh") if geometry.name == "geometry" else None
        if mesh is None:
            return []
        parts = [self._part(geometry, element) for element in mesh.children if element.name in KINDS]
        return [part for part in parts if len(part.polygons)]

    def _part(self, geometry: Element, primitive: Element) -> Part:
        inputs = [element.attributes for element in primitive.all("input")]
        width = 1 + max((_number(i.get("offset", "0")) for i in inputs), default=0)
        counts, rows = _faces(primitive, width, len(self.data))
        others: dict[str, tuple[str, NDArray[np.int64]]] = {}
        positions, corners = "", np.zeros(0, np.int64)
        for attributes in inputs:
            semantic, id = attributes.get("semantic", ""), attributes.get("source", "").removeprefix("#")
            column = rows[:, _number(attributes.get("offset", "0"))]
            if semantic != "VERTEX":
                others.setdefault(semantic if semantic not in others else FURTHER + semantic, (id, column))
                continue
            vertices = self._by_id.get(id)
            for shared in vertices.all("input") if vertices is not None else ():
                name, source = shared.attributes.get("semantic", ""), shared.attributes.get("source", "")
                if name == "POSITION":
                    positions, corners = source.removeprefix("#"), column
                else:
                    others.setdefault(name, (source.removeprefix("#"), column))
        if not positions:
            raise ReadError("faces of this COLLADA file have no positions: export it again")
        if self._array(positions).values.shape[1] != 3:
            raise ReadError(
                f"the source {positions!r} of this COLLADA file is not of three coordinates: export it again"
            )
        polygons, places = _polygons(primitive.name, counts, corners)
        chosen = {name: (id, column[places]) for name, (id, column) in others.items()}
        named = geometry.attributes.get("id", ""), primitive.attributes.get("material", "")
        return Part(*named, positions, polygons, chosen)

    def _moved_pieces(self) -> Iterable[Piece]:
        edits = self._edits(self._first, self._changed, self.positions) + self._normal_edits()
        if len({begin for begin, _, _ in edits}) < len(edits):
            raise ReadError("positions and normals of this COLLADA file share an array: export it again")
        return edited(self.data, sorted(edits))

    def _edits(self, starts: dict[str, int], new: NDArray[np.bool_], values: NDArray[Any]) -> list[Edit]:
        """Return the edits of sources that begin at these rows of the values, where `new` ones replace old ones."""
        edits = []
        for id, start in starts.items():
            array = self._array(id)
            rows = slice(start, start + len(array.values))
            if new[rows].any():
                edits.append(_edit(array, array.words[new[rows]], values[rows][new[rows]]))
        return edits

    def _normal_edits(self) -> list[Edit]:
        used = [part.others.get("NORMAL") for part in self._parts]
        ids = [id for id in dict.fromkeys(found[0] for found in used if found) if id in self._by_id]
        ids = [id for id in ids if self._array(id).values.shape[1] == 3]
        none = (("", np.full(len(part.polygons.corners), -1)) for part in self._parts)
        corners = [found or missing for found, missing in zip(used, none, strict=True)]
        starts, normals, renewed = self._renewed_tables({id: self._array(id).values for id in ids}, corners)
        return self._edits(starts, renewed, np.where(renewed[:, None], normals, 0).astype(np.float32))

    def refers_to(self) -> dict[str, bool]:
        """Return the names of images, which are not changed."""
        images = [element for image in self._root.all("library_images", "image") for element in image.within()]
        uris = [
            unescape(self.data[slice(*image.span)].decode("utf-8", "surrogateescape")).strip()
            for image in images
            if image.name in ("init_from", "ref") and not image.children
        ]
        return {name.removeprefix("./"): False for uri in uris if (name := relative_name(uri)) is not None}

    @property
    def vertex_values(self) -> Mapping[str, NDArray[Any]]:
        """(k,) colours and texture coordinates of the positions, if all meshes have them."""
        of_sources = [[part for part in self._parts if part.positions == source] for source in self._sources]
        return joined([self._shape(parts) for parts in of_sources]).vertex_values

    def face_labels(self) -> list[Labels]:
        """Return the symbols of materials and the names of geometries."""
        names = [self._by_id[p.geometry].attributes.get("name", p.geometry) if p.geometry else "" for p in self._parts]
        sizes = [len(part.polygons) for part in self._parts]
        labels = {"mesh": names, "material": [part.material for part in self._parts]}
        return [Labels.of_parts(kind, values, sizes) for kind, values in labels.items()]

    def _read_content(self) -> Content:
        of_geometry: dict[str, dict[str, list[Part]]] = {}
        for part in self._parts:
            of_geometry.setdefault(part.geometry, {}).setdefault(part.positions, []).append(part)

        def nbytes(element: Element) -> int:
            id = element.attributes.get("id", "") if element.name == "geometry" else ""
            return 8 * sum(
                3 * len(self._array(source).values) + sum(len(part.polygons.corners) for part in parts)
                for source, parts in of_geometry.get(id, {}).items()
            )

        roots, inner = instances(self._root, self._by_id)
        found = placements(roots, inner, nbytes, len(self.data))
        named = [(element.attributes.get("id", ""), matrix) for element, matrix in found if element.name == "geometry"]
        places = [place for place in named if place[0] in of_geometry]
        places = places or [(id, np.eye(4)) for id in of_geometry]  # a library of geometries
        shown = [placed(self._shape(parts), matrix) for id, matrix in places for parts in of_geometry[id].values()]
        left_out = [what for library, what in KEPT_ELSEWHERE.items() if self._root.first(library) is not None]
        left_out += ["lines"] if any(element.name in LINES for element in self._root.within()) else []
        whole = joined(shown)
        kept = [semantic for semantic, names in CONVERTED.items() if names[0] in whole.vertex_values]
        lost = dict.fromkeys(semantic for part in self._parts for semantic in part.others if semantic not in kept)
        left_out += dict.fromkeys(SEMANTICS.get(semantic.removeprefix(FURTHER), semantic) for semantic in lost)
        left_out += ["the unit"] if self._root.first("asset", "unit") is not None else []
        left_out += ["the up axis"] if self._root.first("asset", "up_axis") is not None else []
        if set(of_geometry) - {id for id, _ in places}:
            left_out.append("meshes that the scene does not show")
        return replace(whole, left_out=tuple(left_out))

    def _shape(self, parts: list[Part]) -> Content:
        """Return parts with the same positions as one mesh."""
        first, count = self._first[parts[0].positions], len(self._array(parts[0].positions).values)
        polygons = Polygons.joined([part.polygons for part in parts])
        values = dict[str, NDArray[Any]]()
        for semantic, names in CONVERTED.items():
            columns = [self._at_corners(part, semantic, names) for part in parts]
            stored = [column for column in columns if column is not None]
            if len(stored) < len(parts):
                continue
            width = min(column.shape[1] for column in stored)
            found = values_of_vertices(np.concatenate([c[:, :width] for c in stored]), polygons.corners, count)
            if found is not None:
                values |= dict(zip(names, (as_bytes(found) if semantic == "COLOR" else found).T, strict=False))
        return Content(self.positions[first : first + count], polygons, values)

    def _at_corners(self, part: Part, semantic: str, names: tuple[str, ...]) -> NDArray[np.float64] | None:
        """Return the values of a semantic with these names at the corners of a part, or None if a corner has none.

        The last of four values, alpha, may be missing.
        """
        id, rows = part.others.get(semantic, ("", np.zeros(0, np.int64)))
        values = self._array(id).values if id in self._by_id else np.zeros((0, 0))
        if values.shape[1] < min(len(names), 3) or (rows < 0).any() or (rows >= len(values)).any():
            return None
        return values[rows, : len(names)]

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write content with the colours and texture coordinates of vertices."""
        colors, texture, names = Look.of(content.vertex_values)
        found = {"POSITION": ("XYZ", content.positions), "COLOR": ("RGB", colors), "TEXCOORD": ("ST", texture)}
        arrays = {semantic: (letters, values) for semantic, (letters, values) in found.items() if values is not None}
        sources = [_source(semantic.lower(), *array) for semantic, array in arrays.items()]
        inputs = [b'<input semantic="%b" source="#%b"/>' % (s.encode(), s.lower().encode()) for s in arrays]
        counts, corners = content.polygons.counts, content.polygons.corners
        numbers = [lines_of(b"", a[:, None]).replace(b"\n", b" ").strip() for a in (counts, corners)]
        document = COLLADA_TEMPLATE % (b"\n".join(sources), b"".join(inputs), len(counts), *numbers)
        return [document], content.lost_values(names)


def _edit(array: SourceArray, words: NDArray[Any], values: NDArray[Any]) -> Edit:
    """Return the edit that replaces words of an array. A word that several vectors share gets the last value."""
    order = np.argsort(words.ravel(), kind="stable")
    ascending = words.ravel()[order]
    last = np.append(ascending[1:] != ascending[:-1], True)
    pieces = replace_words(array.text, (ascending[last], values.ravel()[order][last]))
    return array.begin, array.end, b"".join(pieces)


def _faces(primitive: Element, width: int, size: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the number of corners of each face, strip or fan, and the indices of the corners, (c, width)."""
    lists = [_numbers(element) for element in primitive.all("p")]
    if primitive.first("ph") is not None:
        raise ReadError("polygons of this COLLADA file have holes: triangulate it")
    rows = np.concatenate([np.zeros(0, np.int64), *lists])
    vcount = primitive.first("vcount") if primitive.name == "polylist" else None
    if vcount is not None:
        counts = _numbers(vcount)
        check_expansion(40.0 * float(np.abs(counts.astype(float)).sum()), size, "the polygons of this COLLADA file")
    elif primitive.name == "triangles":
        counts = np.full(len(rows) // (3 * width), 3)
    else:
        counts = np.array([len(numbers) // width for numbers in lists], np.int64)
    if (counts < 0).any() or int(counts.sum()) * width != len(rows):
        raise ReadError("the faces of this COLLADA file do not fit together: get a complete copy")
    return counts, rows.reshape(-1, width)


def _polygons(kind: str, counts: NDArray[np.int64], corners: NDArray[np.int64]) -> tuple[Polygons, NDArray[np.int64]]:
    """Return polygons, and the index of each of their corners among the given corners."""
    if kind not in ("tristrips", "trifans"):
        return Polygons.from_counts(counts, corners), np.arange(len(corners))
    cut = strips if kind == "tristrips" else fans
    rows = cut(counts, np.arange(len(corners))).corners.reshape(-1, 3)
    rows = rows[~repeats_vertex(corners[rows])]
    return Polygons.from_rows(corners[rows]), rows.ravel()


def _numbers(element: Element) -> NDArray[np.int64]:
    """Return the integers in the content of an element."""
    text = Text(element.numbers)
    return text.integers(np.arange(len(text.starts)))


def _number(word: str) -> int:
    try:
        value = int(word)
    except ValueError:
        value = -1
    if not 0 <= value < 2**31:
        raise ReadError(f"{word[:40]!r} in this COLLADA file is not a whole number that it may be: export it again")
    return value


def _source(name: str, letters: str, values: NDArray[Any]) -> bytes:
    """Return a source with the given vectors."""
    numbers = lines_of(b"", values)
    parameters = "".join(f'<param name="{letter}" type="float"/>' for letter in letters)
    return (
        f'<source id="{name}"><float_array id="{name}-array" count="{values.size}">\n'.encode()
        + numbers
        + f'</float_array><technique_common><accessor source="#{name}-array" count="{len(values)}" '
        f'stride="{len(letters)}">{parameters}</accessor></technique_common></source>'.encode()
    )


COLLADA_TEMPLATE = b"""<?xml version="1.0" encoding="UTF-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>1980-01-01T00:00:00Z</created><modified>1980-01-01T00:00:00Z</modified></asset>
<library_geometries><geometry id="mesh"><mesh>
%b
<vertices id="vertices">%b</vertices>
<polylist count="%d"><input semantic="VERTEX" source="#vertices" offset="0"/>
<vcount>%b</vcount>
<p>%b</p></polylist>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="scene"><node id="node"><instance_geometry url="#mesh"/></node></visual_scene>\
</library_visual_scenes>
<scene><instance_visual_scene url="#scene"/></scene>
</COLLADA>
"""
