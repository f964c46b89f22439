"""GLB, the binary form of glTF 2: positions and normals are replaced in its buffer, all else stays.

Positions are those of the meshes themselves, before the transforms of the nodes that show them; skins, morph
targets and animations apply to the moved vertices as they did before.
"""

import copy
import json
import struct
from collections.abc import Iterable
from typing import Any

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

Accessor = tuple[int, int, int]
"""First byte in the buffer, step, and number of elements."""


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
        self._positions: dict[Accessor, tuple[int, list[int]]] = {}  # its first row, and the numbers of its accessors
        self._normals: dict[Accessor, NDArray[np.int64]] = {}  # rows of the positions that its normals belong to
        blocks, parts, triangles, rows = [], [], [np.zeros((0, 3), np.int64)], 0
        for part, mesh in enumerate(self._document.get("meshes", [])):
            for primitive in mesh["primitives"]:
                number = primitive["attributes"].get("POSITION")
                if number is None:
                    continue
                accessor = self._accessor(number)
                if accessor not in self._positions:
                    blocks.append(_vectors(self._chunks.get(BIN, b""), accessor).astype(np.float32))
                    parts.append(np.full(accessor[2], part))
                    self._positions[accessor] = rows, []
                    rows += accessor[2]
                first, numbers = self._positions[accessor]
                numbers.append(number)
                found = self._triangles(primitive, accessor[2])
                if ((found < 0) | (found >= accessor[2])).any():
                    raise ReadError(f"mesh {part} names vertex {found.max()}, but has {accessor[2]}: export it again")
                triangles.append(found + first)
                if "NORMAL" in primitive["attributes"]:
                    normals = self._accessor(primitive["attributes"]["NORMAL"])
                    if normals[2] == accessor[2]:
                        self._normals.setdefault(normals, first + np.arange(accessor[2]))
        self.parts = np.concatenate([np.zeros(0, np.int64), *parts])
        positions = np.concatenate([np.zeros((0, 3), np.float32), *blocks])
        return positions, Polygons.from_rows(np.concatenate(triangles))

    def _accessor(self, number: int) -> Accessor:
        """Return where vectors lie; raises ReadError where they are no plain vectors of floats in the buffer."""
        accessor = self._document["accessors"][number]
        if (accessor["componentType"], accessor["type"]) != (FLOAT, "VEC3") or "sparse" in accessor:
            raise ReadError(f"accessor {number} is sparse, or not of 3 floats: export the file without that")
        return self._place(accessor, 12)

    def _place(self, accessor: dict[str, Any], size: int) -> Accessor:
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
        document = copy.deepcopy(self._document)
        for accessor, (first, numbers) in self._positions.items():
            moved = self.positions[first : first + accessor[2]]
            _vectors(buffer, accessor)[:] = moved
            for number in numbers if len(moved) else ():
                document["accessors"][number].update(
                    min=moved.min(axis=0).astype(float).tolist(), max=moved.max(axis=0).astype(float).tolist()
                )
        for accessor, rows in self._normals.items():
            stored = np.full(self.positions.shape, np.nan)
            stored[rows] = _vectors(buffer, accessor)
            normals, renewed = self._renewed(Normals(stored, self.triangles))
            _vectors(buffer, accessor)[renewed[rows]] = normals[rows][renewed[rows]]
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


def _vectors(buffer: bytes | bytearray, accessor: Accessor) -> NDArray[np.float32]:
    """View the vectors of an accessor."""
    start, step, count = accessor
    return np.ndarray((count, 3), "<f4", buffer, start, (step, 4)) if count else np.zeros((0, 3), np.float32)


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
