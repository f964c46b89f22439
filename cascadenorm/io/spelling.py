"""Numbers as text, with the fewest digits from which their type gets them back, laid out as Python and numpy do."""

from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from cascadenorm.io.text import blocks

PLAIN = {np.dtype(np.float32): (1e-4, 1e6), np.dtype(np.float64): (1e-4, 1e16)}
"""From where to where numbers have no exponent; orjson writes those beyond in another way."""


def spelled(values: NDArray[Any]) -> NDArray[np.bytes_]:
    """Spell each number of an array, row after row."""
    return np.array(rows_of(values.reshape(-1, 1)), "S32")


def rows_of(values: NDArray[Any]) -> list[bytes]:
    """Spell the rows of a table, with spaces between the numbers."""
    rows = list[bytes]()
    for block in blocks(len(values), values.shape[1]):
        part = values[block]
        found = _joined(part, b"\n").split(b"\n")
        for row in np.flatnonzero(_beyond(part).any(axis=1)).tolist():
            found[row] = b" ".join(_word(value) for value in part[row])
        rows += found
    return rows


def lines_of(keyword: bytes, *tables: NDArray[Any]) -> bytes:
    """Spell tables side by side, a line for each row, which begins with the keyword if that is not empty."""
    begin = b"\n" + keyword + b" " if keyword else b"\n"
    if len(tables) == 1 and not _beyond(tables[0]).any():  # all rows at once, in half the time
        rows = [_joined(tables[0][block], begin) for block in blocks(len(tables[0]), tables[0].shape[1])]
    elif len(tables) == 1:
        rows = rows_of(tables[0])
    else:
        rows = [b" ".join(words) for words in zip(*map(rows_of, tables), strict=True)]
    return (begin.join([b"", *rows]) + b"\n").removeprefix(b"\n")


def _joined(values: NDArray[Any], between: bytes) -> bytes:
    """Spell the rows of a table that has some, with spaces between the numbers and some text between the rows."""
    native = np.ascontiguousarray(values, values.dtype.newbyteorder("="))
    rows = orjson.dumps(native, option=orjson.OPT_SERIALIZE_NUMPY)[2:-2]  # between [[ and ]]
    return rows.replace(b"],[", between).replace(b",", b" ")


def _beyond(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell which numbers are not finite, or have an exponent."""
    if values.dtype not in PLAIN:
        return np.zeros(values.shape, bool)
    least, large = PLAIN[values.dtype]
    size = np.abs(values)
    return np.asarray(~(((size >= least) & (size < large)) | (size == 0)))


def _word(value: Any) -> bytes:
    return str(value).encode() if value.dtype == np.float32 else repr(value.item()).encode()
