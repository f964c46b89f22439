"""Numbers as text, with the fewest digits from which their type gets them back, laid out as Python and numpy do."""

from itertools import chain
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from cascadenorm.io.text import blocks
from cascadenorm.io.tokenizer import apart
from cascadenorm.mesh import any_in_rows

WIDTH = 32
"""Letters that are enough for any number."""

PLAIN = {np.dtype(np.float32): (1e-4, 1e6), np.dtype(np.float64): (1e-4, 1e16)}
"""From where to where numbers have no exponent; orjson writes those beyond in another way."""


def spelled(values: NDArray[Any]) -> NDArray[np.bytes_]:
    """Spell each number of an array, row after row."""
    flat = _native(values.ravel())
    out = np.zeros(len(flat), f"S{WIDTH}")
    for block in blocks(len(flat)):
        text = orjson.dumps(flat[block], option=orjson.OPT_SERIALIZE_NUMPY)[1:-1]  # between [ and ]
        apart(np.frombuffer(text, np.uint8), out[block].view(np.uint8).reshape(-1, WIDTH))
        beyond = block.start + np.flatnonzero(_beyond(flat[block]))
        out[beyond] = [_word(value) for value in flat[beyond]]
    return out


def rows_of(values: NDArray[Any]) -> list[bytes]:
    """Spell the rows of a table, with spaces between the numbers."""
    parts = [_spelled(values[block], b"\n").split(b"\n") for block in blocks(len(values), values.shape[1])]
    return list(chain(*parts))


def lines_of(keyword: bytes, *tables: NDArray[Any]) -> bytes:
    """Spell tables side by side, a line for each row, which begins with the keyword if that is not empty."""
    begin = b"\n" + keyword + b" " if keyword else b"\n"
    if len(tables) == 1:  # the rows of a block at once, in half the time
        rows = [_spelled(tables[0][block], begin) for block in blocks(len(tables[0]), tables[0].shape[1])]
    else:
        rows = [b" ".join(words) for words in zip(*map(rows_of, tables), strict=True)]
    return (begin.join([b"", *rows]) + b"\n").removeprefix(b"\n")


def _spelled(values: NDArray[Any], between: bytes) -> bytes:
    """Spell the rows of a table that has some, with spaces between the numbers and a line break between the rows."""
    text = orjson.dumps(_native(values), option=orjson.OPT_SERIALIZE_NUMPY)[2:-2]  # between [[ and ]]
    text = text.replace(b"],[", between).replace(b",", b" ")
    beyond = np.flatnonzero(any_in_rows(_beyond(values)))
    if len(beyond):
        rows = text.split(between)
        for row in beyond.tolist():
            rows[row] = b" ".join(map(_word, values[row]))
        text = between.join(rows)
    return text


def _native(values: NDArray[Any]) -> NDArray[Any]:
    """Return values as orjson takes them."""
    return np.ascontiguousarray(values, values.dtype.newbyteorder("="))


def _beyond(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell which numbers are not finite, or have an exponent."""
    if values.dtype not in PLAIN:
        return np.zeros(values.shape, bool)
    least, large = PLAIN[values.dtype]
    size = np.abs(values)
    return np.asarray(~(((size >= least) & (size < large)) | (size == 0)))


def _word(value: Any) -> bytes:
    return str(value).encode() if value.dtype == np.float32 else repr(value.item()).encode()
