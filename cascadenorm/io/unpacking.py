"""Limit how much meshio and nibabel decompress.

A few bytes can expand to a thousand times as many.
"""

import lzma
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import ModuleType
from typing import Any

from cascadenorm.io.limits import check_expansion, expansion_limit

_room: ContextVar["_Room | None"] = ContextVar("room", default=None)
"""Remaining memory for decompression inside a block of `limited_expansion`."""


class _Room:
    """Bytes that a file of a given size may still expand to."""

    def __init__(self, size: int) -> None:
        self.size, self.taken = size, 0


class _Limited:
    """A module of the standard library whose `decompress` stops at the limit."""

    def __init__(self, module: Any, decompressor: Any) -> None:
        self._module, self._decompressor = module, decompressor

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)

    def decompress(self, data: bytes) -> bytes:
        """Return decompressed data. Raises ReadError beyond the limit."""
        room = _room.get()
        if room is None:
            return bytes(self._module.decompress(data))
        left = int(expansion_limit(room.size)) - room.taken
        unpacked = bytes(self._decompressor().decompress(data, max(left, 0) + 1))
        room.taken += len(unpacked)
        check_expansion(room.taken, room.size, "the compressed arrays of this file")
        return unpacked


LIMITED = {"zlib": _Limited(zlib, zlib.decompressobj), "lzma": _Limited(lzma, lzma.LZMADecompressor)}


@contextmanager
def limited_expansion(size: int, reader: ModuleType) -> Iterator[None]:
    """Limit decompression in a library module inside this block to what a file of this size may expand to."""
    for name, stands_for in LIMITED.items():
        if getattr(reader, name, None) is sys.modules[name]:
            setattr(reader, name, stands_for)
    token = _room.set(_Room(size))
    try:
        yield
    finally:
        _room.reset(token)
