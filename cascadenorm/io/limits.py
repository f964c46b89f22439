"""Limits on the memory that the content of a file may need, relative to the size of the file."""

import lzma
import os
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from types import ModuleType
from typing import Any

from cascadenorm.errors import ParameterError, ReadError

VARIABLE = "CASCADENORM_MAX_EXPANSION"  # environment variable that overrides EXPANSION
EXPANSION = 200.0
"""Largest expansion: bytes in memory per byte of a file. Compressed meshes reach 20."""
MOST_BYTES_SHOWN = 10**18  # bytes beyond which a number is not written out; a file may announce numbers of any length
ALWAYS = 100_000_000  # bytes that a file of any size may expand to


def check_expansion(needed: float, size: int, what: str) -> None:
    """Raise ReadError if `what` needs more bytes of memory than a file of `size` bytes may expand to."""
    if needed > expansion_limit(size):
        raise ReadError(
            f"{what} need {min(needed, MOST_BYTES_SHOWN) / 1e6:,.0f} MB, more than {_expansion():g} times the size of "
            "the file",
            hint=f"if it can be trusted, set the environment variable {VARIABLE} to a larger number",
        )


def expansion_limit(size: int) -> float:
    """Return the number of bytes that a file of a given size may expand to."""
    return max(ALWAYS, _expansion() * size)


def _expansion() -> float:
    text = os.environ.get(VARIABLE, "") or str(EXPANSION)
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not value >= 1:
        raise ParameterError(f"the environment variable {VARIABLE} is {text!r}; it must be a number of at least 1")
    return value


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
