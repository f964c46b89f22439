"""A JSON text of which single values are replaced and nothing else."""

import json
import re
from typing import Any

DECODER = json.JSONDecoder()
SPACE = re.compile(r"[\ufeff \t\n\r]*")

Path = tuple[str | int, ...]
"""Names and numbers that lead from the outermost value to one within."""


class JsonText:
    """A JSON document and the text that it was read from.

    Parameters
    ----------
    data
        UTF-8; bytes that are none come out as they went in.

    Raises
    ------
    ValueError
        No valid JSON.
    RecursionError
        Nested too deeply.
    """

    def __init__(self, data: bytes) -> None:
        self.text = data.decode("utf-8", "surrogateescape")
        self.document: Any = json.loads(self.text.removeprefix("\ufeff"))

    def replaced(self, values: dict[Path, Any]) -> bytes:
        """Return the text with the values at these paths replaced; a path that leads nowhere is passed over."""
        changes = sorted(self._changes((_skipped(self.text, 0), len(self.text)), values))
        parts, last = [], 0
        for begin, end, spelling in changes:
            parts += [self.text[last:begin], spelling]
            last = end
        return "".join([*parts, self.text[last:]]).encode("utf-8", "surrogateescape")

    def _changes(self, span: tuple[int, int], values: dict[Path, Any]) -> list[tuple[int, int, str]]:
        """Return place and new spelling of each value within a span."""
        if () in values:
            return [(*span, json.dumps(values[()], separators=(",", ":")))]
        inner: dict[str | int, dict[Path, Any]] = {}
        for (first, *rest), value in values.items():
            inner.setdefault(first, {})[tuple(rest)] = value
        found = _members(self.text, span[0]) if inner else {}
        return [change for key in inner if key in found for change in self._changes(found[key], inner[key])]


def _members(text: str, begin: int) -> dict[str | int, tuple[int, int]]:
    """Return the place of each value of the object or array that begins here; of equal names the last one counts."""
    found: dict[str | int, tuple[int, int]] = {}
    if text[begin] not in "[{":
        return found
    place = _skipped(text, begin + 1)
    while text[place] not in "]}":
        key: str | int = len(found)
        if text[begin] == "{":
            key, place = DECODER.raw_decode(text, place)
            place = _skipped(text, _skipped(text, place) + 1)  # behind the colon
        _, end = DECODER.raw_decode(text, place)
        found[key] = place, end
        place = _skipped(text, end)
        if text[place] == ",":
            place = _skipped(text, place + 1)
    return found


def _skipped(text: str, place: int) -> int:
    match = SPACE.match(text, place)
    assert match is not None
    return match.end()
