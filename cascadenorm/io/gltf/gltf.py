"""glTF 2, in JSON or GLB: replace positions and normals, as they are before the transforms of nodes; keep all else."""

import copy
import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError, counted
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import Content, Labels, Positions
from cascadenorm.io.gltf.accessors import STORED, Accessors, ByteOffsets, NewAccessors, Primitive, StoredVectors
from cascadenorm.io.gltf.buffers import Buffers, embedded, entry, with_keys
from cascadenorm.io.gltf.document import (
    check_lists,
    document_content,
    document_of,
    instances,
    joined_primitives,
    json_bytes,
    parsed,
    shape_content,
)
from cascadenorm.io.gltf.patching import PatchedDocument
from cascadenorm.io.hole_patches import HolePatches
from cascadenorm.io.libraries import explained
from cascadenorm.io.shown import joined
from cascadenorm.io.sidecar_files import relative_name
from cascadenorm.mesh import Bools, all_in_rows, any_in_rows, box_of, marked
from cascadenorm.mesh.normals import Normals
from cascadenorm.mesh.polygons import Polygons, fans, strips

GLB_MAGIC = b"glTF"
JSON, BIN = b"JSON", b"BIN\0"
TRIANGLES, STRIP, FAN = 4, 5, 6
COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
"""Extensions that store compressed geometry. The file may also contain uncompressed positions, but moving only these
would not change what is shown."""


def _said(error: Exception) -> str:
    """Describe an error that an entry of a document caused, which may have any type."""
    if isinstance(error, KeyError):
        return f"the key or value {error} is missing or unknown"
    if isinstance(error, IndexError):
        return "a number refers to an entry that does not exist"
    if isinstance(error, RecursionError):
        return "its objects are nested too deeply"
    return "an entry has the wrong type or size" if isinstance(error, TypeError | AttributeError) else str(error)


_explained = partial(explained, "the JSON of this file is not valid glTF 2", hint="export the file again", said=_said)
"""Convert errors from documents of an unexpected form to ReadError."""


class GltfFile(MeshFile):
    """A glTF document with any number of meshes, in JSON with embedded or separate buffers. Positions are float32."""

    format = "gltf"

    def _unpacked(self) -> tuple[bytes, Piece | None]:
        """Return the JSON, and the buffer in the container, if there is one. Raises ReadError."""
        return self.data, None

    def _packed(self, text: bytes, chunk: Piece | None) -> Iterable[Piece]:
        """Return the container with other JSON and another buffer, in pieces."""
        return [text]

    @classmethod
    def _made(cls, document: dict[str, Any], chunk: Piece | None) -> Iterable[Piece]:
        """Return a container, in pieces, for a document and its first buffer if that has no content of its own."""
        if chunk is not None:
            document["buffers"][0]["uri"] = embedded(chunk)
        return [json_bytes(document)]

    @_explained()
    def _parse(self) -> tuple[NDArray[np.float32], Polygons]:
        text, self._chunk = self._unpacked()
        self._document = document = parsed(text)
        check_lists(document)
        extensions = [*document.get("extensionsRequired", []), *document.get("extensionsUsed", [])]
        used = [name for name in COMPRESSED if name in extensions]
        if used:
            raise ReadError(f"this glTF file is compressed ({used[0]}): export it without compression")
        self._buffers = Buffers(document.get("buffers", []), self._chunk, self.folder)
        self._accessors = Accessors(document, self._buffers, len(self.data))
        self._primitives = [
            self._primitive(mesh, number, primitive)
            for mesh, number, primitive in _declared_primitives(document)
            if "POSITION" in primitive["attributes"]
        ]
        self._stored = StoredVectors.joined([p.positions for p in self._primitives])
        self._stored_normals = StoredVectors.joined([p.normals for p in self._primitives])
        places = np.concatenate([self._stored.at, self._stored_normals.at])
        order = np.argsort(places, kind="stable")  # merges two ascending sequences
        self._moving_files = self._buffers.files_with(places[order])
        if (places[order][1:] < np.concatenate([self._stored.ends, self._stored_normals.ends])[order][:-1]).any():
            raise ReadError("positions and normals of this glTF file overlap in their buffer: export it again")
        self._check_others()
        if (self._stored.kinds != 0).any():  # integers
            self.moving_loses = ("precision beyond that of the integers that store the positions",)
        self.parts, kinds = self._meshes_of_positions(), self._stored.kinds
        mixed = bool((kinds[1:] != kinds[:-1]).any())
        parts = np.zeros(1, np.int64) if self.parts is None else self.parts
        if mixed and len(np.unique(parts * len(STORED) + kinds)) > len(np.unique(parts)):
            raise ReadError(
                "a mesh of this glTF file stores positions in several component types, so seams would open: "
                "export it with one"
            )
        self._corner_normals = _stacked([self._rows_of_normals(p) for p in self._primitives])
        triangles = _stacked([self._stored.rows_of(p.positions, p.triangles) for p in self._primitives])
        return self._stored.read(self._buffers.data), Polygons.from_rows(triangles)

    def _check_others(self) -> None:
        """Raise ReadError if positions or normals share bytes with indices or other attributes."""
        for accessor in self._other_accessors():
            spans: list[tuple[ByteOffsets, int]] = []
            with suppress(ReadError, KeyError, IndexError):  # accessors that cannot be read are kept unchanged
                spans = self._accessors.spans(accessor)
            for places, size in spans:
                if any(vectors.overlap(places, size) for vectors in (self._stored, self._stored_normals)):
                    raise ReadError(
                        f"accessor {accessor} of this glTF file overlaps with positions or normals in their buffer: "
                        "export it again"
                    )

    def _other_accessors(self) -> list[int]:
        """Return the numbers of the accessors of primitives that do not store positions or normals to be moved."""
        moving = {p.attributes.get(name) for p in self._primitives for name in ("POSITION", "NORMAL")}
        found: set[int] = set()
        for _, _, primitive in _declared_primitives(self._document):
            found |= {primitive["indices"]} if "indices" in primitive else set()
            for attributes in (primitive["attributes"], *primitive.get("targets", [])):
                found |= set(attributes.values())
        return sorted(found - moving)

    def _meshes_of_positions(self) -> NDArray[np.int64] | None:
        """Return (k,) the first mesh that each position belongs to, or None if there is only one mesh."""
        if len({primitive.mesh for primitive in self._primitives}) < 2:
            return None
        meshes = np.zeros(len(self._stored.at), np.int64)
        for primitive in reversed(self._primitives):
            meshes[self._rows(primitive)] = primitive.mesh
        return meshes

    def _primitive(self, mesh: int, number: int, primitive: dict[str, Any]) -> Primitive:
        attributes = primitive["attributes"]
        positions = self._accessors.vectors(attributes["POSITION"])
        normals, count = StoredVectors.joined([]), len(positions.at)
        if "NORMAL" in attributes and len((stored := self._accessors.vectors(attributes["NORMAL"])).at) == count:
            normals = stored
        triangles = self._triangles(primitive, count)
        if (triangles >= count).any():
            raise ReadError(
                f"a face references vertex {triangles.max()} of {count}, counted from 0: the glTF file is damaged; "
                "get a complete copy"
            )
        return Primitive(mesh, number, primitive.get("material"), attributes, positions, normals, triangles)

    def _triangles(self, primitive: dict[str, Any], vertex_count: int) -> NDArray[np.int64]:
        """Return the (m, 3) vertices of the triangles of a primitive, counted from 0 within it."""
        mode = primitive.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN):
            return np.zeros((0, 3), np.int64)
        corners = np.arange(vertex_count)
        if "indices" in primitive:
            found = self._accessors.values(primitive["indices"])
            if found.dtype.kind != "u" or found.shape[1] != 1:
                raise ReadError("the vertex indices of this glTF file are not integers: export it again")
            corners = found[:, 0].astype(np.int64)
        if mode == TRIANGLES:
            return corners[: len(corners) // 3 * 3].reshape(-1, 3)
        cut = strips if mode == STRIP else fans
        return cut(np.array([len(corners)]), corners).corners.reshape(-1, 3)

    def _rows_of_normals(self, primitive: Primitive) -> NDArray[np.int64]:
        if not len(primitive.normals.at):
            return np.full(primitive.triangles.shape, -1)
        return self._stored_normals.rows_of(primitive.normals, primitive.triangles)

    def _rows(self, primitive: Primitive) -> NDArray[np.int64]:
        return self._stored.rows_of(primitive.positions, np.arange(len(primitive.positions.at)))

    def _storable(self, positions: Positions) -> Positions:
        """Return positions rounded to the integers in which the file stores them, if it does."""
        if (self._stored.kinds == 0).all():
            return positions
        finite = all_in_rows(np.isfinite(positions))
        data = bytearray(self._buffers.data)
        self._stored.put(data, positions, finite)
        return np.where(finite[:, None], self._stored.read(data), positions)

    def _moved_pieces(self) -> Iterable[Piece]:
        return self._replaced({})[0]

    def _replaced(self, names: dict[int, str]) -> tuple[Iterable[Piece], dict[int, Piece]]:
        """Return the container, in pieces, and the moved buffers that get one of these names; others are embedded."""
        data = bytearray(self._buffers.data)
        self._stored.put(data, self.positions, any_in_rows(self._changed))
        stored = self._stored_normals.read(data)
        if len(stored):
            normals, renewed = self._renewed(Normals(stored, self._corner_normals))
            self._stored_normals.put(data, normals, renewed)
        document, chunk, files = self._with_new_bounds(data), None, dict[int, Piece]()
        for number, content in self._buffers.replaced(data, self._moving_files).items():
            uri = self._buffers.declared[number].get("uri")
            if uri is None:
                chunk = content
            elif number in names:
                files[number] = content
                document["buffers"][number]["uri"] = quote(names[number], errors="surrogateescape")
            else:
                document["buffers"][number]["uri"] = embedded(content, uri)
        return self._packed(json_bytes(document), chunk), files

    def _with_new_bounds(self, data: bytearray) -> dict[str, Any]:
        """Return the document with the new bounds of positions and normals. Its buffers are copies."""
        lists = {name: [dict(part) for part in self._document.get(name, [])] for name in ("accessors", "buffers")}
        for primitive in self._primitives:
            for name, places in ("POSITION", primitive.positions), ("NORMAL", primitive.normals):
                vectors, before = places.raw(data), places.raw(self._buffers.data)
                if not ((vectors != before) & ~np.isnan(before)).any():
                    continue
                finite = all_in_rows(np.isfinite(vectors))
                if finite.any():
                    lower, upper = box_of(vectors if finite.all() else vectors[finite])
                    accessor = lists["accessors"][primitive.attributes[name]]
                    bounds = {"min": lower.tolist(), "max": upper.tolist()}
                    accessor |= {key: bound for key, bound in bounds.items() if key in accessor}
        return {**self._document, **{name: parts for name, parts in lists.items() if parts}}

    def files(self, path: Path, *, part_name: str = "{}") -> dict[Path, Iterable[Piece]]:
        """Return the files to write at a path. Buffers with vertices in separate files get files beside it."""
        if not self.has_moved:
            return super().files(path)
        names = {n: beside.with_name(part_name.format(beside.name)) for n, beside in self._buffer_names(path).items()}
        pieces, buffers = self._replaced({number: beside.name for number, beside in names.items()})
        return {**{names[number]: [content] for number, content in buffers.items()}, path: pieces}

    def may_write(self, path: Path) -> list[Path]:
        return [*self._buffer_names(path).values(), path]

    def _buffer_names(self, path: Path) -> dict[int, Path]:
        """Return where buffers with vertices are written, under names that no other file of the document has."""
        numbers, found = self._moving_files, dict[int, Path]()
        kept = {name.casefold() for name in self._references(without=numbers)}
        for number in numbers:
            further = chain([""] if len(numbers) == 1 else [], (f"_{number}{'_' * more}" for more in count()))
            names = (f"{path.stem}{ending}.bin" for ending in further)
            found[number] = path.with_name(next(name for name in names if name.casefold() not in kept))
        return found

    def refers_to(self) -> dict[str, bool]:
        """Return the names of separate files that are not changed: images, and buffers, which are required."""
        return self._references(without=self._moving_files if self.has_moved else [])

    def _references(self, *, without: list[int]) -> dict[str, bool]:
        """Return the result of `refers_to` if the buffers with these numbers are rewritten."""
        document = self._document
        buffers = [part for number, part in enumerate(document.get("buffers", [])) if number not in without]
        images = {relative_name(part.get("uri")): False for part in document.get("images", [])}
        names = {**images, **{relative_name(part.get("uri")): True for part in buffers}}
        return {name: needed for name, needed in names.items() if name is not None}

    @property
    @_explained()
    def vertex_values(self) -> Mapping[str, NDArray[Any]]:
        """(k,) colours and texture coordinates of the positions, if all primitives with triangles have them."""
        shapes = joined_primitives(self._primitives)
        accessors = self._accessors.for_reading()
        shown = [shape_content(shape, accessors, self.positions[self._rows(shape)]) for shape in shapes]
        rows = np.concatenate([np.zeros(0, np.int64), *map(self._rows, shapes)])
        found = dict[str, NDArray[Any]]()
        for name, values in joined(shown).vertex_values.items():
            found[name] = np.zeros(len(self.positions), values.dtype)
            found[name][rows] = values
        return found

    @_explained()
    def face_labels(self) -> list[Labels]:
        """Return the names of meshes and of materials."""
        sizes, labels = [len(p.triangles) for p in self._primitives], list[Labels]()
        for kind, declared in ("mesh", "meshes"), ("material", "materials"):
            parts = self._document.get(declared, [])
            numbers = [getattr(p, kind) for p in self._primitives]
            names = ["" if number is None else parts[number].get("name", "") for number in numbers]
            labels.append(Labels.of_parts(kind, names, sizes))
        return labels

    def repacked(self, kind: type[MeshFile]) -> MeshFile | None:
        """Return this file in the other container without loss, or None for other formats."""
        if not issubclass(kind, GltfFile):
            return None
        here = self._as_stored()
        document, chunk = copy.deepcopy(here._document), None
        if document.get("buffers"):
            begin, end = here._buffers.place(0)
            chunk = here._buffers.data[begin:end]
            document["buffers"][0].pop("uri", None)
        return kind(b"".join(kind._made(document, chunk)), self.folder)

    def with_patches(self, patches: HolePatches) -> "GltfFile":
        """Return this file with an additional primitive for each patch, with the mesh and material of its surroundings.

        Texture coordinates, colours and other values are interpolated from the surroundings. If a patch crosses a seam
        of the texture coordinates, its material has no texture. Existing primitives and buffers are kept.
        """
        stored = np.zeros((len(self.positions), 3))
        for primitive in self._primitives:
            if len(primitive.normals.at):
                stored[self._rows(primitive)] = primitive.normals.read(self._buffers.data)
        added = self._further_accessors()
        rows = [self._rows(p) for p in self._primitives]
        arrays = self.positions, self.welds, stored
        with _explained():
            made = PatchedDocument(self._document, self._accessors, self._primitives, rows, *arrays, patches, added)
        if made.untextured:
            what = counted(made.untextured, "patch", "patches")
            patches.left_out.append(f"textures on {what} across seams of the texture coordinates")
        return self._with_document(made.document, added)

    @_explained()
    def without(self, triangles: Bools) -> "GltfFile | None":
        """Return this file without some of its triangles, (m,), of which no vertex is used by others.

        Primitives and meshes without triangles are removed. The buffers keep the vertices of the others, unused and at
        the position of another vertex of the mesh. Returns None unless the scene shows each mesh once.
        """
        shown = Counter(mesh for mesh, _ in instances(self._document))
        if shown and any(shown[mesh] != 1 for mesh in {p.mesh for p in self._primitives if len(p.triangles)}):
            return None
        moved = self._at_kept_vertices(triangles)
        document, added = copy.deepcopy(moved._document), moved._further_accessors()
        ends = np.cumsum([len(p.triangles) for p in self._primitives])
        for p, gone in zip(self._primitives, np.split(triangles, ends[:-1]), strict=True):
            primitive = document["meshes"][p.mesh]["primitives"][p.number]
            if len(gone) and gone.all():
                primitive.clear()
            elif gone.any():
                primitive["indices"] = added.add(p.triangles[~gone].astype("<u4").reshape(-1, 1), indices=True)
                primitive.pop("mode", None)
        for mesh in document["meshes"]:
            mesh["primitives"] = [primitive for primitive in mesh["primitives"] if primitive]
        kept = [number for number, mesh in enumerate(document["meshes"]) if mesh["primitives"]]
        numbers = {number: place for place, number in enumerate(kept)}
        for node in document.get("nodes", []):
            if node.get("mesh") in numbers:
                node["mesh"] = numbers[node["mesh"]]
            else:
                for key in ("mesh", "skin", "weights"):
                    node.pop(key, None)
        lists = {"meshes": [document["meshes"][number] for number in kept]}
        if len(added.data):
            lists |= {"accessors": added.accessors, "bufferViews": added.views}
        return moved._with_document({**document, **lists}, added)

    def _at_kept_vertices(self, triangles: Bools) -> "GltfFile":
        """Return this file with the vertices of some triangles at the position of another vertex of their mesh."""
        corners = self.polygons.corners.reshape(-1, 3)
        gone = marked(corners[triangles], len(self.positions))
        gone[corners[~triangles]] = False
        parts = np.zeros(len(gone), np.int64) if self.parts is None else self.parts
        kept = corners[~triangles].ravel()[::-1]
        first = np.full(int(parts.max(initial=0)) + 1, -1)  # kept vertex of each mesh
        first[parts[kept]] = kept
        rows = np.flatnonzero(gone & (first[parts] >= 0))
        file = copy.copy(self)
        file.positions = self.positions.copy()
        file.positions[rows] = self.positions[first[parts[rows]]]
        return file._as_stored()

    def _further_accessors(self) -> NewAccessors:
        """Return accessors to be added to those of this file."""
        inner = self._has_inner_buffer
        begin, buffer = (len(self._chunk or b""), 0) if inner else (0, len(self._buffers.declared))
        return NewAccessors(self._document, buffer=buffer, begin=begin)

    @property
    def _has_inner_buffer(self) -> bool:
        """Whether the first buffer is that of the container."""
        return self._chunk is not None and "uri" not in self._buffers.declared[0]

    def _with_document(self, document: dict[str, Any], added: NewAccessors) -> "GltfFile":
        """Return this file with another document, which uses accessors that were added."""
        buffers, chunk, data = copy.deepcopy(self._buffers.declared), self._chunk, bytes(added.data)
        if self._has_inner_buffer:
            chunk = bytes(chunk or b"") + data + bytes(-len(data) % 4)
            buffers[0]["byteLength"] = len(chunk)
        elif data:
            buffers.append({"byteLength": len(data), "uri": embedded(data)})
        text = json_bytes({**document, "buffers": buffers})
        return type(self)(b"".join(self._packed(text, chunk)), self.folder)

    @_explained()
    def _read_content(self) -> Content:
        return document_content(
            self._document, self._accessors.for_reading(), self._primitives, lambda p: self.positions[self._rows(p)]
        )

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write content with the colours and texture coordinates of vertices."""
        document, buffer, lost = document_of(content)
        return cls._made(document, buffer), lost


class GlbFile(GltfFile):
    """A GLB file, which holds the JSON and the first buffer. Chunks of other types are kept."""

    format = "glb"

    def _unpacked(self) -> tuple[bytes, Piece | None]:
        chunks = dict(reversed(list(_chunks(self.data))))  # the first of several chunks with one name counts
        if JSON not in chunks:
            raise ReadError("this GLB file has no JSON chunk: it is damaged; get a complete copy")
        return bytes(chunks[JSON]), chunks.get(BIN)

    def _packed(self, text: bytes, chunk: Piece | None) -> Iterable[Piece]:
        replaced: dict[bytes, Piece] = {JSON: _padded(text, b" ")}
        if chunk is not None:
            replaced[BIN] = chunk
        chunks = [(name, replaced.pop(name, old)) for name, old in _chunks(self.data)]  # the first of each name
        (length,) = struct.unpack_from("<I", self.data, 8)
        return [*_container(chunks), self.data[length:]]

    @classmethod
    def _made(cls, document: dict[str, Any], chunk: Piece | None) -> Iterable[Piece]:
        inner = [] if chunk is None else [(BIN, _padded(chunk, b"\0"))]
        return _container([(JSON, _padded(json_bytes(document), b" ")), *inner])


def _declared_primitives(document: dict[str, Any]) -> Iterator[tuple[int, int, dict[str, Any]]]:
    """Yield the primitives with the numbers of their meshes and their own. Raises ReadError if a key is missing."""
    for mesh in range(len(document.get("meshes", []))):
        for number, primitive in enumerate(entry(document, "meshes", mesh, "primitives")["primitives"]):
            yield mesh, number, with_keys(primitive, f"meshes[{mesh}].primitives[{number}]", "attributes")


def _stacked(parts: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Concatenate parts, (m, 3) each. A single part is returned without a copy."""
    return parts[0] if len(parts) == 1 else np.concatenate([np.zeros((0, 3), np.int64), *parts])


def _container(chunks: Sequence[tuple[bytes, Piece]]) -> list[Piece]:
    """Return a GLB file of chunks by name, in pieces."""
    body = [piece for name, chunk in chunks for piece in (struct.pack("<I4s", len(chunk), name), chunk)]
    return [GLB_MAGIC + struct.pack("<II", 2, 12 + sum(map(len, body))), *body]


def _padded(chunk: Piece, padding: bytes) -> bytes:
    return b"".join([chunk, padding * (-len(chunk) % 4)])


def _chunks(data: bytes) -> Iterable[tuple[bytes, memoryview]]:
    """Yield the chunks of a GLB file by name. Raises ReadError if it is truncated or has another version."""
    if data[:4] != GLB_MAGIC or len(data) < 20:
        raise ReadError("this is not a GLB file: it does not begin with 'glTF', or ends within its header")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise ReadError(f"this GLB file has version {version}; only version 2 is supported: export it again")
    if length > len(data):
        raise ReadError(f"the GLB header declares {length} bytes, but the file has {len(data)}: it is truncated")
    at = 12
    while at + 8 <= length:
        size, name = struct.unpack_from("<I4s", data, at)
        if at + 8 + size > length:
            raise ReadError(f"the chunk at byte {at} declares {size} bytes and runs past the end: the file is damaged")
        yield name, memoryview(data)[at + 8 : at + 8 + size]
        at += 8 + size
