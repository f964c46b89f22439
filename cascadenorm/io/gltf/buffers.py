"""The entries of a glTF document, and its buffers: a chunk of a GLB file, text in the JSON, or separate files."""

import base64
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.base import Piece
from cascadenorm.io.sidecar_files import file_beside, is_within, relative_name
from cascadenorm.io.text.text import blocks

EMBEDDED = "data:application/octet-stream;base64,"


class Buffers:
    """The buffers with vertices, concatenated in `data` as they are requested; `folder` is None for a stream."""

    def __init__(self, declared: list[dict[str, Any]], chunk: Piece | None, folder: Path | None) -> None:
        for number, part in enumerate(declared):
            name = relative_name(part.get("uri"))
            if name is not None and not is_within(name):
                raise ReadError(
                    f"buffer {number} is {name[:200]!r}, outside the folder of this file: put it beside this file"
                )
        self.declared, self._chunk, self._folder = declared, chunk, folder
        self.data: Piece = b""
        self.places: dict[int, tuple[int, int]] = {}
        """Where the buffers begin and end in `data`."""

    def place(self, number: int) -> tuple[int, int]:
        """Return where a buffer begins and ends in `data`. Raises ReadError if it is not available."""
        if number not in self.places:
            found = self._load(number)
            self.places[number] = len(self.data), len(self.data) + len(found)
            self.data = b"".join([self.data, found]) if self.data else found
        return self.places[number]

    def replaced(self, data: bytearray, numbers: list[int]) -> dict[int, Piece]:
        """Return by number the buffers that differ in other data, and those with these numbers, as views of it."""
        before, after, places = memoryview(self.data), memoryview(data), self.places.items()
        return {
            n: after[begin:end]
            for n, (begin, end) in places
            if n in numbers or _differ(before[begin:end], after[begin:end])
        }

    def files_with(self, places: NDArray[np.int64]) -> list[int]:
        """Return the numbers of buffers in separate files that contain one of these ascending byte offsets."""
        return sorted(
            number
            for number, (begin, end) in self.places.items()
            if relative_name(self.declared[number].get("uri")) is not None
            and np.searchsorted(places, begin) < np.searchsorted(places, end)
        )

    def _load(self, number: int) -> Piece:
        exists = isinstance(number, int) and 0 <= number < len(self.declared)
        uri = self.declared[number].get("uri") if exists else None
        if uri is None:
            if number == 0 and self._chunk is not None:
                return self._chunk
            raise ReadError(f"buffer {number!r} of the glTF document has no data: export the file again")
        if uri.startswith("data:"):
            return _embedded(uri, number)
        name = relative_name(uri)
        if name is None:
            raise ReadError(
                f"buffer {number} is at {uri[:200]!r}, and only relative file names are read: put it beside this file"
            )
        if self._folder is None:
            raise ReadError(
                f"the vertices are in another file, {name!r}, which cannot be found from a stream: "
                "give the name of the glTF file, or export it as GLB"
            )
        path = file_beside(self._folder, name)
        if path is None:
            raise ReadError(f"the vertices are in {name!r}, which does not exist beside this file: put it there")
        try:
            return path.read_bytes()
        except OSError as error:
            raise ReadError(f"{name!r}, which holds the vertices, cannot be read: {error.strerror or error}") from None


def _differ(one: memoryview, other: memoryview) -> bool:
    """Whether views of equal length differ, compared block by block."""
    return any(bytes(one[block]) != bytes(other[block]) for block in blocks(len(one)))


def embedded(data: Piece, like: str = "") -> str:
    """Return a URI that embeds data, with the same header as another one."""
    head = like.partition(",")[0] + "," if like.startswith("data:") else EMBEDDED
    return head + base64.b64encode(data).decode()


def _embedded(uri: str, number: int) -> bytes:
    head, _, text = uri.partition(",")
    if not head.endswith(";base64"):
        raise ReadError(f"buffer {number} is embedded as {head[:60]!r}, not in base64: export the file again")
    try:
        return base64.b64decode(text + "=" * (-len(text) % 4), validate=True)
    except ValueError as error:
        raise ReadError(f"buffer {number} is embedded in invalid base64 ({error}): get a complete copy") from None


def entry(document: dict[str, Any], name: str, number: Any, *keys: str) -> dict[str, Any]:
    """Return an entry of a list of a document. Raises ReadError if it does not exist or lacks one of the keys."""
    parts = document.get(name, [])
    if not isinstance(number, int) or not 0 <= number < len(parts):
        raise ReadError(f"the glTF document refers to {name}[{number!r}], which does not exist: export the file again")
    return with_keys(parts[number], f"{name}[{number}]", *keys)


def with_keys(part: Any, place: str, *keys: str) -> dict[str, Any]:
    """Return an object of a document, at a place such as accessors[0]. Raises ReadError if it lacks one of the keys."""
    if not isinstance(part, dict):
        raise ReadError(f"{place} in the glTF document is not an object: export the file again")
    missing = [key for key in keys if key not in part]
    if missing:
        raise ReadError(f"{place} in the glTF document has no {missing[0]!r}: export the file again")
    return part
