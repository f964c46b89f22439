"""Text files as words with known positions, so that numbers can be replaced without any other change."""

import re
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError, counted
from cascadenorm.io.text.tokenizer import Offsets, begins_with, decimals, find_words
from cascadenorm.mesh import parallel_for

NOT_FINITE = re.compile(rb"[+-]?(nan\(\w*\)|\d\.#\w+)", re.I)  # as some C libraries format it
WORDS_AT_A_TIME = 1 << 18  # words processed at a time
SINGLE_DIGITS = 9  # significant digits up to which single precision restores a number
SPACE = 32  # white space is at most this byte and follows each word except the last

Edit = tuple[int, int, bytes]  # begin and end of a byte range, and its replacement


class Text:
    """The words of a text and its non-empty lines. A word that begins with # ends its line.

    `starts` and `ends`, (w,), are the byte offsets of the words; `first` and `stop`, (l,), the first word of each line
    and the word after its last one. They are int32 in texts below 2 GiB, which halves the memory.
    """

    def __init__(self, data: bytes, *, start: int = 0, continued: bool = False) -> None:
        self.data = data
        self.bytes = np.frombuffer(data, np.uint8)
        continued = continued and b"\\" in data
        kind = np.int32 if len(data) < 2**31 else np.int64
        most = 2 + sum(int(np.count_nonzero(self.bytes[part] <= SPACE)) for part in blocks(len(data)))
        empty: list[Offsets] = [np.empty(most, kind) for _ in range(3)]  # untouched memory is not committed
        starts, ends, borders = empty
        words, lines = find_words(self.bytes, start, continued, starts, ends, borders)
        borders[lines] = words
        self.starts = starts[:words]
        self.ends = ends[:words]
        self.first = borders[:lines]
        self.stop = borders[1 : lines + 1]

    def lines_with(self, keyword: bytes) -> Offsets:
        """Return the lines whose first word is the keyword, ignoring case."""
        found = np.empty(len(self.first), bool)
        letters = np.frombuffer(keyword, np.uint8)
        parallel_for(len(found), begins_with, self.bytes, self.starts, self.ends, self.first, letters, found)
        return np.flatnonzero(found)

    def line_number(self, place: int) -> int:
        """Return the line number, counted from 1, of a byte offset."""
        before = self.data[: int(place)]
        return 1 + before.count(b"\n") + before.count(b"\r") - before.count(b"\r\n")

    def without_lines(self, lines: Offsets) -> bytes:
        """Return the text without some lines, given in ascending order, and their line ends."""
        whole = np.append(self.bytes, np.zeros(2, np.uint8))
        ends = np.append(np.flatnonzero(np.isin(self.bytes, (ord("\r"), ord("\n")))), len(self.bytes))
        stops = ends[np.searchsorted(ends, self.ends[self.stop[lines] - 1])] + 1
        stops += (whole[stops - 1] == ord("\r")) & (whole[stops] == ord("\n"))
        borders = np.zeros(len(whole), np.int8)
        borders[np.append(0, ends + 1)[np.searchsorted(ends, self.starts[self.first[lines]])]] += 1
        borders[stops] -= 1
        return bytes(self.bytes[np.cumsum(borders, dtype=np.int8)[: len(self.bytes)] == 0])

    def word(self, index: int) -> bytes:
        return self.data[int(self.starts[index]) : int(self.ends[index])]

    def significant_digits(self, words: Offsets) -> int:
        """Return the largest number of significant digits in a sample of about a thousand of the words."""
        sample = words[:: max(1, len(words) // 1000)]
        places = zip(self.starts[sample].tolist(), self.ends[sample].tolist(), strict=True)
        return max((digits_of(self.data[start:end]) for start, end in places), default=0)

    def columns(self, lines: Offsets, count: int, *, start: int = 1) -> Offsets:
        """Return `count` words of each line from number `start` on, (l, count). Raises ReadError if there are fewer."""
        self.require(lines, np.full(len(lines), start + count))
        return self.first[lines][:, None] + np.arange(start, start + count, dtype=self.first.dtype)

    def require(self, lines: Offsets, words: Offsets) -> None:
        """Raise ReadError at the first line that has fewer words than it needs."""
        short = np.flatnonzero(self.stop[lines] - self.first[lines] < words)
        if len(short):
            line = lines[short[0]]
            raise ReadError(
                f"line {self.line_number(self.starts[self.first[line]])} has "
                f"{counted(int(self.stop[line] - self.first[line]), 'value')} and needs {words[short[0]]}: "
                "the file is truncated there, or damaged; get a complete copy"
            )

    def numbers(self, words: Offsets, *, lax: bool = False) -> NDArray[np.float64]:
        """Parse words as numbers. Other words become nan if `lax`; otherwise the first raises ReadError."""
        return self.numbers_at(self.starts[words], self.ends[words], lax=lax)

    def numbers_at(self, starts: Offsets, ends: Offsets, *, lax: bool = False) -> NDArray[np.float64]:
        """Parse numbers at byte offsets. Other words become nan if `lax`; otherwise the first raises ReadError."""
        values, simple = np.empty(starts.size), np.empty(starts.size, bool)
        starts, ends, shape = starts.ravel(), ends.ravel(), starts.shape
        parallel_for(len(values), decimals, self.bytes, starts, ends, values, simple)
        odd = np.flatnonzero(~simple)
        places = zip(starts[odd].tolist(), ends[odd].tolist(), strict=True)
        values[odd] = [self._number(*place, lax) for place in places]
        return values.reshape(shape)

    def integers(self, words: Offsets) -> NDArray[np.int64]:
        """Parse words as integers. Raises ReadError at the first that is not an integer."""
        return self.integers_at(self.starts[words], self.ends[words])

    def integers_at(self, starts: Offsets, ends: Offsets) -> NDArray[np.int64]:
        """Parse integers at byte offsets. Raises ReadError at the first that is not an integer."""
        flat_starts, flat_ends, integers = starts.ravel(), ends.ravel(), np.empty(starts.size, np.int64)
        for block in blocks(starts.size):
            values = self.numbers_at(flat_starts[block], flat_ends[block])
            bad = np.flatnonzero(~((values == np.rint(values)) & (np.abs(values) < 2**53)))
            if len(bad):
                start, end = int(flat_starts[block][bad[0]]), int(flat_ends[block][bad[0]])
                raise ReadError(f"line {self.line_number(start)}: {shown(self.data[start:end])} is not a whole number")
            integers[block] = values
        return integers.reshape(starts.shape)

    def _number(self, start: int, end: int, lax: bool) -> float:
        word = self.data[start:end]
        try:
            return float(word)
        except ValueError:
            if lax or NOT_FINITE.fullmatch(word):
                return np.nan
            raise ReadError(
                f"line {self.line_number(start)}: {shown(word)} is not a number: "
                "correct this line, or export the file again"
            ) from None


def digits_of(word: bytes) -> int:
    """Return the number of significant digits of a number."""
    return len(re.sub(rb"\D", b"", re.split(rb"[eE]", word)[0]).strip(b"0"))


def as_short(values: NDArray[Any], digits: int) -> NDArray[Any]:
    """Return numbers with at most so many significant digits in single precision if that restores them."""
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    return values if digits > SINGLE_DIGITS or (np.isinf(single) & np.isfinite(values)).any() else single


def shown(word: bytes) -> str:
    """Return the beginning of a word in quotes, for messages."""
    return repr(word[:40].decode("latin-1"))


def blocks(count: int, width: int = 1) -> Iterator[slice]:
    """Split the range 0 … count, with `width` words per item, into parts that limit the working memory."""
    size = max(WORDS_AT_A_TIME // max(width, 1), 1)
    return (slice(start, start + size) for start in range(0, count, size))


def edited(data: bytes, edits: Iterable[Edit]) -> list[bytes]:
    """Apply edits, in ascending order, to bytes; return the result in pieces."""
    pieces, last = list[bytes](), 0
    for begin, end, new in edits:
        pieces += (data[last:begin], new)
        last = end
    return [*pieces, data[last:]]
