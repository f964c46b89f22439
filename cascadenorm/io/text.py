"""Text files as words with known places, so that single numbers can be replaced and nothing else."""

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.io.contract import ReadError

Places = NDArray[np.int64]

SPACE, LINE_END = np.zeros(256, bool), np.zeros(256, bool)
SPACE[list(b" \t\r\n\v\f\0")] = True
LINE_END[list(b"\r\n")] = True


class Text:
    """The words of a text, and the lines that have any.

    Attributes
    ----------
    data : the text, as it came
    starts, ends : (w,) places of the words
    first, stop : (l,) the words of each line; a word that begins with # ends it
    """

    def __init__(self, data: bytes, *, start: int = 0, continued: bool = False) -> None:
        self.data = data
        self.bytes = np.frombuffer(data, np.uint8)
        body = self.bytes[start:]
        space = np.concatenate([[True], SPACE[body], [True]])
        line_ends = np.flatnonzero(LINE_END[body])
        if continued and data.find(b"\\", start) >= 0:
            line_ends = self._join_lines(space, line_ends, start)
        borders = np.flatnonzero(space[1:] != space[:-1]) + start
        self.starts, self.ends = borders[::2], borders[1::2]
        leading = np.searchsorted(self.starts, line_ends + start)
        lines = np.unique(np.concatenate([[0], leading, [len(self.starts)]]))
        self.first, self.stop = lines[:-1], lines[1:].copy()
        self._drop_comments()

    def _join_lines(self, space: NDArray[np.bool_], line_ends: Places, start: int) -> Places:
        """Make a backslash before a line end a space, and the line end none, except in comments."""
        body = self.bytes[start:]
        before = line_ends - 1 - ((body[line_ends] == 10) & (line_ends > 1) & (body[line_ends - 1] == 13))
        joins = (before >= 0) & (body[np.maximum(before, 0)] == ord("\\"))
        joined = np.zeros(len(line_ends), bool)
        for i in np.flatnonzero(joins).tolist():
            line_start = int(line_ends[i - 1]) + 1 if i else 0
            if self.data[start + line_start : start + int(before[i])].lstrip()[:1] != b"#":
                joined[i] = True
                space[1 + before[i]] = True
        carriage = np.flatnonzero(joined) - 1  # the \r of a joined \r\n is no line end either
        carriage = carriage[(carriage >= 0) & (body[line_ends[carriage]] == 13)]
        joined[carriage[line_ends[carriage] + 1 == line_ends[carriage + 1]]] = True
        return line_ends[~joined]

    def _drop_comments(self) -> None:
        hashes = np.flatnonzero(self.bytes[self.starts] == ord("#"))
        lines = np.searchsorted(self.first, hashes, "right") - 1
        np.minimum.at(self.stop, lines, hashes)

    def lines_with(self, keyword: bytes) -> NDArray[np.int64]:
        """Return the lines whose first word is the keyword, in lower case or in capitals."""
        start, end = self.starts[self.first], self.ends[self.first]
        lines = np.flatnonzero(end - start == len(keyword))
        for i, letter in enumerate(keyword):
            lines = lines[self.bytes[start[lines] + i] | 0x20 == letter]
        return lines[self.stop[lines] > self.first[lines]]

    def line_number(self, place: int) -> int:
        """Return the line of the file, counted from 1, in which a byte lies."""
        before = self.data[: int(place)]
        return 1 + before.count(b"\n") + before.count(b"\r") - before.count(b"\r\n")

    def word(self, index: int) -> bytes:
        """Return a word."""
        return self.data[int(self.starts[index]) : int(self.ends[index])]

    def replaced(self, words: Places, spellings: list[bytes]) -> list[bytes | memoryview]:
        """Return the text, in pieces, with words replaced."""
        order = np.argsort(words)
        view, pieces, last = memoryview(self.data), list[bytes | memoryview](), 0
        starts, ends = self.starts[words[order]].tolist(), self.ends[words[order]].tolist()
        for i, start, end in zip(order.tolist(), starts, ends, strict=True):
            pieces += (view[last:start], spellings[i])
            last = end
        pieces.append(view[last:])
        return pieces

    def columns(self, lines: Places, count: int, *, start: int = 1) -> Places:
        """Return the words of each line from the one numbered `start`, (l, count); raises ReadError where too few."""
        self.require(lines, np.full(len(lines), start + count))
        return self.first[lines][:, None] + np.arange(start, start + count)

    def require(self, lines: Places, words: Places) -> None:
        """Raise ReadError at the first line that has fewer words than it needs."""
        short = np.flatnonzero(self.stop[lines] - self.first[lines] < words)
        if len(short):
            line = lines[short[0]]
            raise ReadError(
                f"line {self.line_number(self.starts[self.first[line]])} has "
                f"{self.stop[line] - self.first[line]} words and needs {words[short[0]]}: "
                "the file is truncated there, or damaged; get a complete copy"
            )

    def numbers(self, words: Places, kind: type = float) -> NDArray[Any]:
        """Return the numbers that words, ascending, spell; raises ReadError at the first that is none."""
        return self.numbers_at(self.starts[words], self.ends[words], kind)

    def numbers_at(self, starts: Places, ends: Places, kind: type = float, *, lax: bool = False) -> NDArray[Any]:
        """Return the numbers at places, ascending; what is no number is nan where lax, else raises ReadError."""
        found = _parse(self.bytes, starts.ravel(), ends.ravel(), kind)
        if len(found) != starts.size:
            places = zip(starts.ravel().tolist(), ends.ravel().tolist(), strict=True)
            found = np.array([self._number(start, end, kind, lax) for start, end in places])
        return found.reshape(starts.shape)

    def _number(self, start: int, end: int, kind: type, lax: bool) -> Any:
        spelled = self.data[start:end]
        try:
            return kind(spelled)
        except ValueError:
            if lax:
                return np.nan
            raise ReadError(
                f"line {self.line_number(start)}: {spelled[:40].decode('latin-1')!r} is not a number: "
                "correct this line, or write the file again where it came from"
            ) from None


def _parse(data: NDArray[np.uint8], starts: Places, stops: Places, kind: type) -> NDArray[Any]:
    """Parse the numbers at these places, ascending; fewer or more where one is malformed."""
    if not len(starts):
        return np.zeros(0, kind)
    origin, end = int(starts[0]), int(stops[-1])
    border = np.zeros(end - origin + 2, np.int8)
    border[starts - origin] += 1
    border[stops - origin + 1] -= 1
    inside = np.cumsum(border[:-1], dtype=np.int8).view(bool)
    chosen = np.append(data[origin:end], np.uint8(32))[inside]
    chosen[np.cumsum(stops - starts + 1) - 1] = 32
    with warnings.catch_warnings():  # numpy warns where it stops early; the caller sees it by the count
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            return np.fromstring(chosen.tobytes(), kind, sep=" ")
        except ValueError:
            return np.zeros(0, kind)


def spelled(values: NDArray[Any]) -> list[bytes]:
    """Spell each number with the fewest digits from which its type gets it back."""
    flat = values.ravel()
    if flat.dtype == np.float32:
        return flat.astype("S32").tolist()
    return [b"%r" % value for value in flat.tolist()]


def rows_of(values: NDArray[Any]) -> list[bytes]:
    """Spell the rows of a table, with spaces between the numbers."""
    words = iter(spelled(values))
    return list(map(b" ".join, zip(*[words] * values.shape[1], strict=True)))
