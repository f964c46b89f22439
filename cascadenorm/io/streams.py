"""Write all bytes to a stream that may accept few at once."""

import io
from collections.abc import Iterable
from selectors import EVENT_WRITE, DefaultSelector
from typing import BinaryIO

from cascadenorm.errors import OutputError
from cascadenorm.io.base import Piece


def write_stream(stream: BinaryIO, pieces: Iterable[Piece]) -> None:
    """Write pieces to a stream and flush it. Waits while a non-blocking stream is full.

    Raises OutputError if not all bytes can be written.
    """
    try:
        for piece in pieces:
            _write(stream, memoryview(piece).cast("B"))
        _flush(stream)
    except BrokenPipeError:
        raise OutputError("the stream was closed by its reader before all was written") from None
    except OSError as error:
        raise OutputError(f"the stream cannot be written: {error.strerror or error}") from error


def _write(stream: BinaryIO, left: memoryview) -> None:
    while len(left):
        try:
            written = stream.write(left)
        except BlockingIOError as error:
            written = error.characters_written
            _wait(stream)
        if isinstance(stream, io.RawIOBase) and written is None:  # the stream is full
            _wait(stream)
            continue
        left = left[len(left) if written is None else written :]


def _flush(stream: BinaryIO) -> None:
    while True:
        try:
            stream.flush()
            return
        except BlockingIOError:
            _wait(stream)


def _wait(stream: BinaryIO) -> None:
    """Wait until a stream accepts bytes again."""
    with DefaultSelector() as selector:
        selector.register(stream, EVENT_WRITE)
        selector.select()
