"""GLB, the binary container of glTF.

It contains the JSON, followed by the first buffer.
"""

import struct
from collections.abc import Iterable
from typing import Any

from cascadenorm.errors import ReadError
from cascadenorm.io.base import Piece
from cascadenorm.io.gltf.document import encoded
from cascadenorm.io.gltf.gltf import GltfContainer

GLB_MAGIC = b"glTF"
JSON, BIN = b"JSON", b"BIN\0"


class GlbFile(GltfContainer):
    """A GLB file. Chunks of other types are kept."""

    format = "glb"

    def _unpacked(self) -> tuple[bytes, Piece | None]:
        chunks = dict(reversed(list(_chunks(self.data))))  # the first of several chunks with one name counts
        if JSON not in chunks:
            raise ReadError("this GLB file has no JSON chunk: it is damaged; get a complete copy")
        return bytes(chunks[JSON]), chunks.get(BIN)

    def _packed(self, text: bytes, chunk: Piece | None) -> Iterable[Piece]:
        replaced: dict[bytes, Piece] = {JSON: text + b" " * (-len(text) % 4)}
        return _joined(self.data, replaced if chunk is None else {**replaced, BIN: chunk})

    @classmethod
    def _made(cls, document: dict[str, Any], chunk: Piece | None) -> Iterable[Piece]:
        text = encoded(document)
        text += b" " * (-len(text) % 4)
        body: list[Piece] = [struct.pack("<I4s", len(text), JSON), text]
        if chunk is not None:
            padding = bytes(-len(chunk) % 4)
            body += [struct.pack("<I4s", len(chunk) + len(padding), BIN), chunk, padding]
        return [_header(body), *body]


def _header(body: list[Piece]) -> bytes:
    return GLB_MAGIC + struct.pack("<II", 2, 12 + sum(map(len, body)))


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


def _joined(data: bytes, replaced: dict[bytes, Piece]) -> list[Piece]:
    """Return the file with the first chunks of these names replaced, in pieces."""
    body: list[Piece] = []
    for name, chunk in _chunks(data):
        new = replaced.pop(name, chunk)
        body += [struct.pack("<I4s", len(new), name), new]
    (length,) = struct.unpack_from("<I", data, 8)
    return [_header(body), *body, data[length:]]
