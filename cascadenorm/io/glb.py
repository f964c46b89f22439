"""GLB, the binary form of glTF 2: positions and normals are replaced in its buffer, all else stays.

Positions are those of the meshes themselves, before the transforms of the nodes that show them; skins, morph
targets and animations apply to the moved vertices as they did before.
"""

import copy
import json
import struct
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.io.contract import Content, MeshFile, Piece, ReadError
from cascadenorm.io.foreign import foreign
from cascadenorm.io.normals import Normals
from cascadenorm.io.polygons import Polygons, strips

MAGIC = b"glTF"
JSON, BIN = b"JSON", b"BIN\0"
INDEX_KINDS = {5121: "<u1", 5123: "<u2", 5125: "<u4"}
FLOAT = 5126
TRIANGLES, STRIP, FAN = 4, 5, 6
COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_mesh_quantization")

VECTOR = 12  # bytes of three floats


class Primitive(NamedTuple):
    """Triangles of one material.

    Parameters
    ----------
    number : accessor of its positions
    positions, normals : byte of each in the buffer; no normals, or one for each position
    triangles : (m, 3) rows of both
    """

    number: int
    positions: NDArray[np.int64]
    normals: NDArray[np.int64]
    triangles: NDArray[np.int64]


class GlbFile(MeshFile):
    """A GLB file of any number of meshes; positions are float32."""

    format = "glb"

    def _parse(self) -> tuple[NDArray[np.float32], Polygons]:
        self._chunks = dict(_chunks(self.data))
        try:
            self._document = json.loads(self._chunks[JSON])
            return self._parse_document()
        except (KeyError, IndexError, TypeError, ValueError, AttributeError, RecursionError) as error:
            if isinstance(error, ReadError):
                raise
            raise ReadError(f"the JSON of this GLB file is no valid glTF 2 ({type(error).__name__}: {error})") from None

    def _parse_document(self) -> tuple[NDArray[np.float32], Polygons]:
        used = [name for name in COMPRESSED if name in self._document.get("extensionsRequired", [])]
        if used:
            raise ReadError(f"this GLB file is compressed ({used[0]}): export it without compression")
        primitives = [
            (part, self._primitive(primitive))
            for part, mesh in enumerate(self._document.get("meshes", []))
            for primitive in mesh["primitives"]
            if "POSITION" in primitive["attributes"]
        ]
        none = np.zeros(0, np.int64)
        self._positions_at = np.unique(np.concatenate([none, *(p.positions for _, p in primitives)]))
        self._normals_at = np.unique(np.concatenate([none, *(p.normals for _, p in primitives)]))
        places = np.sort(np.concatenate([self._positions_at, self._normals_at]))
        if (np.diff(places) < VECTOR).any():
            raise ReadError("positions or normals of this GLB file overlap each other: export it again")
        self.parts = np.zeros(len(self._positions_at), np.int64)
        self._bounded = {}
        triangles, normals = [np.zeros((0, 3), np.int64)], [np.zeros((0, 3), np.int64)]
        for part, primitive in reversed(primitives):
            rows = np.searchsorted(self._positions_at, primitive.positions)
            self.parts[rows] = part
            self._bounded[primitive.number] = rows
            triangles.append(rows[primitive.triangles])
            named = np.searchsorted(self._normals_at, primitive.normals)
            normals.append(named[primitive.triangles] if len(named) else np.full(primitive.triangles.shape, -1))
        self._corner_normals = np.concatenate(normals[::-1])
        positions = _vectors(self._chunks.get(BIN, b""), self._positions_at)
        return positions, Polygons.from_rows(np.concatenate(triangles[::-1]))

    def _primitive(self, primitive: dict[str, Any]) -> Primitive:
        number, normal = primitive["attributes"]["POSITION"], primitive["attributes"].get("NORMAL")
        positions = self._vectors_at(number)
        normals = np.zeros(0, np.int64) if normal is None else self._vectors_at(normal)
        triangles = self._triangles(primitive, len(positions))
        if ((triangles < 0) | (triangles >= len(positions))).any():
            raise ReadError(f"a face names vertex {triangles.max()} of {len(positions)}: the GLB file is damaged")
        return Primitive(number, positions, normals if len(normals) == len(positions) else normals[:0], triangles)

    def _vectors_at(self, number: int) -> NDArray[np.int64]:
        """Return the byte of each vector; raises ReadError where they are no plain vectors of floats in the buffer."""
        accessor = self._document["accessors"][number]
        if (accessor["componentType"], accessor["type"]) != (FLOAT, "VEC3") or "sparse" in accessor:
            raise ReadError(f"accessor {number} is sparse, or not of 3 floats: export the file without that")
        start, step, count = self._place(accessor, VECTOR)
        return start + step * np.arange(count)

    def _place(self, accessor: dict[str, Any], size: int) -> tuple[int, int, int]:
        """Return the first byte of an accessor in the buffer, its step, and its number of elements."""
        view = self._document["bufferViews"][accessor["bufferView"]]
        if view["buffer"] != 0 or "uri" in self._document["buffers"][0]:
            raise ReadError("this GLB file keeps its vertices in another file: export it as one file")
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        step, count = view.get("byteStride", size), accessor["count"]
        if not all(isinstance(n, int) and n >= 0 for n in (start, step, count)) or (count and step < size):
            raise ReadError("an accessor of this GLB file has a wrong size: export the file again")
        length = len(self._chunks.get(BIN, b""))
        if count and start + (count - 1) * step + size > length:
            raise ReadError(f"an accessor runs past the {length} bytes of the buffer: the GLB file is damaged")
        return start, step, count

    def _triangles(self, primitive: dict[str, Any], vertex_count: int) -> NDArray[np.int64]:
        """Return the (m, 3) vertices of the triangles of a primitive, counted from 0 within it."""
        mode = primitive.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN):
            return np.zeros((0, 3), np.int64)
        corners = np.arange(vertex_count)
        if "indices" in primitive:
            accessor = self._document["accessors"][primitive["indices"]]
            kind = np.dtype(INDEX_KINDS[accessor["componentType"]])
            start, step, count = self._place(accessor, kind.itemsize)
            found = np.ndarray((count,), kind, self._chunks[BIN], start if count else 0, (step,))
            corners = found.astype(np.int64)
        if mode == STRIP:
            return strips(np.array([len(corners)]), corners).corners.reshape(-1, 3)
        if mode == FAN:
            return np.stack([np.full(max(len(corners) - 2, 0), corners[0]), corners[1:-1], corners[2:]], axis=1)
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)

    def _moved_pieces(self) -> Iterable[Piece]:
        buffer = bytearray(self._chunks[BIN])
        _put(buffer, self._positions_at, self.positions)
        stored = _vectors(buffer, self._normals_at).astype(np.float64)
        if len(stored):
            normals, renewed = self._renewed(Normals(stored, self._corner_normals))
            _put(buffer, self._normals_at[renewed], normals[renewed])
        document = copy.deepcopy(self._document)
        for number, rows in self._bounded.items():
            moved = self.positions[rows].astype(float)
            moved = moved[np.isfinite(moved).all(axis=1)]
            if len(moved):
                document["accessors"][number].update(min=moved.min(axis=0).tolist(), max=moved.max(axis=0).tolist())
        text = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
        return _joined(self.data, {JSON: text + b" " * (-len(text) % 4), BIN: bytes(buffer)})

    def _read_content(self) -> Content:
        return self._as_foreign()(self.data).content()

    @classmethod
    def encode(cls, content: Content) -> tuple[bytes, list[str]]:
        """Write content with the colours of vertices."""
        return cls._as_foreign().encode(content)

    @classmethod
    def _as_foreign(cls) -> type[MeshFile]:
        kind = foreign(cls.format)
        assert kind is not None
        return kind


def _vectors(buffer: bytes | bytearray, places: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return the vectors that begin at these bytes."""
    cells = np.frombuffer(buffer, np.uint8)[places[:, None] + np.arange(VECTOR)]
    return np.asarray(cells.view("<f4").astype(np.float32))


def _put(buffer: bytearray, places: NDArray[np.int64], vectors: NDArray[Any]) -> None:
    """Replace the vectors that begin at these bytes."""
    cells = np.ascontiguousarray(vectors, "<f4").view(np.uint8)
    np.frombuffer(buffer, np.uint8)[places[:, None] + np.arange(VECTOR)] = cells


def _chunks(data: bytes) -> Iterable[tuple[bytes, bytes]]:
    """Return the chunks of a GLB file by their names; raises ReadError where it is cut or of another version."""
    if data[:4] != MAGIC or len(data) < 20:
        raise ReadError("this is no GLB file: it does not begin with 'glTF', or ends within its header")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise ReadError(f"this GLB file is of version {version}, and only 2 is known here: export it again")
    if length > len(data):
        raise ReadError(f"the GLB header promises {length} bytes, but the file has {len(data)}: it is truncated")
    at = 12
    while at + 8 <= length:
        size, name = struct.unpack_from("<I4s", data, at)
        if at + 8 + size > length:
            raise ReadError(f"the chunk at byte {at} promises {size} bytes and runs past the end: the file is damaged")
        yield name, data[at + 8 : at + 8 + size]
        at += 8 + size


def _joined(data: bytes, replaced: dict[bytes, bytes]) -> list[Piece]:
    """Return the file with the first chunks of these names replaced, in pieces."""
    body: list[Piece] = []
    for name, chunk in _chunks(data):
        new = replaced.pop(name, chunk)
        body += [struct.pack("<I4s", len(new), name), new]
    (length,) = struct.unpack_from("<I", data, 8)
    return [MAGIC + struct.pack("<II", 2, 12 + sum(map(len, body))), *body, data[length:]]
