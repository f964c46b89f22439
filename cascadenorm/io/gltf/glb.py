"""GLB, the binary container of glTF: the JSON, followed by the first buffer."""

import struct
from collections.abc import Iterable, Sequence
from typing import Any

from cascadenorm.errors import ReadError
from cascadenorm.io.base import Piece
from cascadenorm.io.gltf.document import json_bytes
from cascadenorm.io.gltf.gltf import GltfFile

GLB_MAGIC = b"glTF"
JSON, BIN = b"JSON", b"BIN\0"


class GlbFile(GltfFile):
    """A GLB file. Chunks of other types are kept."""

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
