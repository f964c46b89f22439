"""Check the sizes of arrays that VTK files declare.

VTK allocates memory for an array before it reads it, and ends the process if there is not enough.
"""

import base64
import math
import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.limits import check_expansion

ARRAY = re.compile(rb"<DataArray\b[^>]*>")
VTK_ATTRIBUTE = re.compile(rb'(\w+)\s*=\s*["\']([^"\']*)["\']')
APPENDED = re.compile(rb"<AppendedData\b([^>]*)>\s*_")
LEGACY_COUNTS = re.compile(
    rb"^[ \t]*(?:(?:POINTS|VERTICES|LINES|POLYGONS|TRIANGLE_STRIPS|POINT_DATA|CELL_DATA|OFFSETS|CONNECTIVITY|METADATA|"
    rb"FIELD[ \t]+\S+|LOOKUP_TABLE[ \t]+\S+|SCALARS[ \t]+\S+[ \t]+\S+|\S+(?=[ \t]+\d+[ \t]+\d+[ \t]+[a-z]\w*[ \t]*$)))"
    rb"[ \t]+(\d+)(?:[ \t]+(\d+))?",
    re.M | re.I,
)
"""Lines of legacy files with one or two counts; the last alternative is that of arrays in a field."""
LEGACY_VERSION = re.compile(rb"#\s*vtk DataFile[ \t]+Version[ \t]+(\d{1,4})\.\d{1,4}\s", re.I)
BINARY_OR_TEXT = re.compile(rb"^[ \t]*(ASCII|BINARY)\s*$", re.M | re.I)
CELL_LIST = re.compile(
    rb"^[ \t]*(?:VERTICES|LINES|POLYGONS|TRIANGLE_STRIPS)[ \t]+(\d+)[ \t]+(\d+)[ \t]*\r?\n", re.M | re.I
)
OFFSETS = re.compile(rb"^[ \t]*OFFSETS[ \t]+[a-z]", re.M | re.I)
UNCOUNTED_FIELD = re.compile(rb"^[ \t]*FIELD(?!\S)(?!\s+\S+\s+\d)", re.M | re.I)
"""A line FIELD without its count, with which VTK crashes."""
NUMBER_OF = re.compile(rb'\b(NumberOf\w+)\s*=\s*["\']([^"\']*)["\']')
COUNTED = ("Tuples", "Points", "Verts", "Lines", "Polys")
DIGITS = 18  # largest number of digits of a count
WORDS = 3
"""Words at the start of a compressed array: the number of blocks, and the sizes of a block and of the last one."""


def check_xml_arrays(data: bytes) -> None:
    """Raise ReadError if an array of an XML file declares more bytes than the file can hold."""
    found = APPENDED.search(data)
    markup = data if found is None else data[: found.start()]
    head = _attributes(markup[: markup.find(b">", markup.find(b"<VTKFile")) + 1])
    word = ">" if head.get(b"byte_order") == b"BigEndian" else "<"
    word += "u8" if head.get(b"header_type") == b"UInt64" else "u4"
    packed = b"compressor" in head
    numbers: dict[str, list[int]] = {}
    for name, value in NUMBER_OF.findall(markup):
        if not value.strip().isdigit() or len(value) > DIGITS:
            said = f'{name.decode()}="{value[:20].decode("ascii", "replace")}"'
            raise ReadError(f"{said} in this vtp file is no count: get a complete copy")
        numbers.setdefault(name.decode().removeprefix("NumberOf"), []).append(int(value))
    width = max(numbers.get("Components", ()), default=1)
    rows = max((number for name in COUNTED for number in numbers.get(name, ())), default=0)
    check_expansion(8.0 * width * rows, len(data), "the arrays of this file")
    for tag in ARRAY.finditer(markup):
        about = _attributes(tag[0])
        if about.get(b"format") == b"binary":
            _check_array(data, tag.end(), word, packed=packed, text=True)
        elif about.get(b"format") == b"appended":
            offset = about.get(b"offset", b"").strip()
            place = len(data) if found is None or not offset.isdigit() else found.end() + int(offset[:DIGITS])
            if found is None or place >= len(data):
                raise ReadError("an array has no place in the appended data of this vtp file: get a complete copy")
            _check_array(data, place, word, packed=packed, text=_attributes(found[1]).get(b"encoding") != b"raw")


def check_legacy_counts(data: bytes) -> None:
    """Raise ReadError if a legacy file declares more points, cells or values than it has bits, or damaged cells."""
    for found in LEGACY_COUNTS.finditer(data):
        if max(len(found[1]), len(found[2] or b"")) > DIGITS or max(int(found[1]), int(found[2] or 0)) > 8 * len(data):
            line = found[0].strip().decode("ascii", "replace")[:60]
            raise ReadError(f"the line '{line}' of this vtk file declares more than it holds: get a complete copy")
    _check_legacy_cells(data)


def _check_legacy_cells(data: bytes) -> None:
    """Raise ReadError if cells or fields are not laid out as the version says, since VTK would follow any number there.

    Up to version 4, a list of cells holds the number of vertices of each cell, followed by the vertices.
    """
    version, kind = LEGACY_VERSION.match(data), BINARY_OR_TEXT.search(data)
    if version is None or kind is None:
        raise ReadError("this vtk file does not begin with its version and ASCII or BINARY: get a complete copy")
    if UNCOUNTED_FIELD.search(data, kind.end()):
        raise ReadError("a line FIELD of this vtk file has no count: the file is truncated; get a complete copy")
    offsets = OFFSETS.search(data) is not None
    if int(version[1]) >= 5 or offsets:
        cells = CELL_LIST.search(data) is not None
        if cells and (int(version[1]) >= 5) != offsets:
            raise ReadError(f"the cells of this vtk file are not those of version {int(version[1])}: export it again")
        return
    for found in CELL_LIST.finditer(data):
        count, size = int(found[1]), int(found[2])
        if kind[1].upper() == b"BINARY":
            rest = data[found.end() : found.end() + 4 * size]
            numbers = np.frombuffer(rest[: len(rest) // 4 * 4], ">i4")
        else:
            words = data[found.end() :].split(None, size)[:size]
            numbers = np.array([int(word) if word.isdigit() else -1 for word in words], np.int64)
        if len(numbers) != size or not _are_cells(numbers, count):
            raise ReadError("the cells of this vtk file do not fit together: get a complete copy")


def _are_cells(numbers: NDArray[Any], count: int) -> bool:
    """Whether numbers hold so many cells, each as the number of its vertices followed by the vertices."""
    if len(numbers) == 4 * count and (numbers[::4] == 3).all():  # triangles
        return True
    at, sizes = 0, numbers.tolist()
    for _ in range(count):
        if at >= len(sizes) or sizes[at] < 0:
            return False
        at += 1 + sizes[at]
    return at == len(sizes)


def _attributes(tag: bytes) -> dict[bytes, bytes]:
    return dict(VTK_ATTRIBUTE.findall(tag))


def _check_array(data: bytes, place: int, word: str, *, packed: bool, text: bool) -> None:
    """Check an array at a place in the data, in base64 or as bytes, which begins with its size in words."""
    words = _words(data, place, WORDS if packed else 1, word, text=text)
    if not packed:
        _check_sizes(data, words[:1])
    elif len(words) == WORDS:
        blocks, size, last = words
        _check_sizes(data, [blocks])
        check_expansion(float(blocks) * size + last, len(data), "the arrays of this file")
        _check_sizes(data, _words(data, place, WORDS + blocks, word, text=text)[WORDS:])


def _check_sizes(data: bytes, sizes: list[int]) -> None:
    if max(sizes, default=0) > len(data):
        raise ReadError("an array of this vtp file declares more bytes than the file has: get a complete copy")


def _words(data: bytes, place: int, count: int, word: str, *, text: bool) -> list[int]:
    """Return the words at a place, or fewer if the file ends earlier. Raises ReadError if they are not in base64.

    VTK also decodes other characters and misplaced padding, which would give sizes that were not checked.
    """
    size = np.dtype(word).itemsize
    if text:
        try:
            found = base64.b64decode(data[place:].lstrip()[: 4 * math.ceil(count * size / 3)], validate=True)
        except ValueError:
            raise ReadError("an array of this vtp file is not in base64: get a complete copy") from None
    else:
        found = data[place : place + count * size]
    return [int(value) for value in np.frombuffer(found[: len(found) // size * size][: count * size], word)]
