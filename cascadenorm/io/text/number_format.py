"""Format numbers with the fewest digits that restore their value, in the layout of Python and numpy."""

from collections.abc import Iterator
from itertools import chain
from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from cascadenorm.io.base import Piece
from cascadenorm.io.text.text import Text, blocks
from cascadenorm.io.text.tokenizer import Offsets, splice
from cascadenorm.mesh import Ints, any_in_rows

PLAIN = {np.dtype(np.float32): (1e-4, 1e6), np.dtype(np.float64): (1e-4, 1e16)}
"""Range in which numbers are formatted without exponent. Outside it, orjson uses another layout."""


def replace_words(text: Text, *tables: tuple[Offsets, NDArray[Any]]) -> Iterator[Piece]:
    """Return a text, in pieces, with words replaced by numbers.

    Each table has (k,) ascending words, which no other table has, and (k,) numbers, formatted according to their type.
    """
    table_of, waiting = np.zeros(len(text.starts), np.int8), [values for _, values in tables]
    for table, (words, _) in enumerate(tables, 1):
        table_of[words] = table
    last = 0
    for block in blocks(len(table_of)):
        replaced = np.flatnonzero(table_of[block])
        if not len(replaced):
            continue

        # Locate the replacement of each word.
        letters, begins, stops = b"", np.empty(len(replaced), np.int64), np.empty(len(replaced), np.int64)
        for table, values in enumerate(waiting):
            own = table_of[block][replaced] == table + 1
            count = np.count_nonzero(own)
            if not count:
                continue
            numbers, first, after = _formatted(values[:count])
            begins[own], stops[own] = first + len(letters), after + len(letters)
            letters, waiting[table] = letters + numbers, values[count:]

        # Copy the text up to the last of these words.
        starts, ends = text.starts[block][replaced] - last, text.ends[block][replaced] - last
        part = text.bytes[last : last + int(ends[-1])]
        out = np.empty(len(part) + len(letters), np.uint8)
        size = splice(part, starts, ends, np.frombuffer(letters, np.uint8), begins, stops, out)
        yield out[:size].data
        last += len(part)
    yield memoryview(text.data)[last:]


def _formatted(values: NDArray[Any]) -> tuple[bytes, Ints, Ints]:
    """Format (k,) numbers. Returns letters, and where in them each number begins and stops."""
    letters = orjson.dumps(_native(values), option=orjson.OPT_SERIALIZE_NUMPY)[1:-1] + b","  # strip [ and ]
    stops = np.flatnonzero(np.frombuffer(letters, np.uint8) == ord(","))
    begins = np.concatenate([np.zeros(1, np.int64), stops[:-1] + 1])
    beyond = np.flatnonzero(_beyond(values))
    words = [_word(value) for value in values[beyond]]  # appended after the others
    stops[beyond] = len(letters) + np.cumsum([len(word) for word in words], dtype=np.int64)
    begins[beyond] = stops[beyond] - [len(word) for word in words]
    return b"".join([letters, *words]), begins, stops


def rows_of(values: NDArray[Any]) -> list[bytes]:
    """Format the rows of a table, with spaces between the numbers."""
    parts = [_row_text(values[block], b"\n").split(b"\n") for block in blocks(len(values), values.shape[1])]
    return list(chain(*parts))


def lines_of(keyword: bytes, *tables: NDArray[Any]) -> bytes:
    """Format tables side by side, one line per row. Each line starts with the keyword unless that is empty."""
    begin = b"\n" + keyword + b" " if keyword else b"\n"
    if len(tables) == 1:  # format the rows of a block together
        rows = [_row_text(tables[0][block], begin) for block in blocks(len(tables[0]), tables[0].shape[1])]
    else:
        rows = [b" ".join(words) for words in zip(*map(rows_of, tables), strict=True)]
    return (begin.join([b"", *rows]) + b"\n").removeprefix(b"\n")


def _row_text(values: NDArray[Any], between: bytes) -> bytes:
    """Format the rows of a non-empty table, with spaces between the numbers and a separator between the rows."""
    text = orjson.dumps(_native(values), option=orjson.OPT_SERIALIZE_NUMPY)[2:-2]  # strip [[ and ]]
    text = text.replace(b"],[", between).replace(b",", b" ")
    beyond = np.flatnonzero(any_in_rows(_beyond(values)))
    if len(beyond):
        rows = text.split(between)
        for row in beyond.tolist():
            rows[row] = b" ".join(map(_word, values[row]))
        text = between.join(rows)
    return text


def _native(values: NDArray[Any]) -> NDArray[Any]:
    """Return values as a contiguous array in native byte order, as orjson requires."""
    return np.ascontiguousarray(values, values.dtype.newbyteorder("="))


def _beyond(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Test which numbers are not finite or need an exponent."""
    if values.dtype not in PLAIN:
        return np.zeros(values.shape, bool)
    least, large = PLAIN[values.dtype]
    size = np.abs(values)
    return np.asarray(~(((size >= least) & (size < large)) | (size == 0)))


def _word(value: Any) -> bytes:
    return str(value).encode() if value.dtype == np.float32 else repr(value.item()).encode()
