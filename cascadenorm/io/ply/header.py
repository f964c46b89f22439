"""Parse the header of a PLY file: its elements and their properties."""

import re
from collections import Counter
from typing import NamedTuple

from cascadenorm.errors import ReadError

TYPE_CODES = ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"]
NAMES = dict(zip(TYPE_CODES, ["char", "uchar", "short", "ushort", "int", "uint", "float", "double"], strict=True))
OTHERS = ["int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"]
LONG = {"int64": "i8", "uint64": "u8"}  # beyond the standard; trimesh writes them
PLY_TYPES = {**{name: code for code, name in NAMES.items()}, **dict(zip(OTHERS, TYPE_CODES, strict=True)), **LONG}
BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


class PlyProperty(NamedTuple):
    """A number, or a list preceded by its length. Types are numpy codes without byte order."""

    name: str
    kind: str
    count_kind: str | None
    place: tuple[int, int]  # span in the file of the word that names the type


class PlyElement(NamedTuple):
    """A table with a given number of rows."""

    name: str
    rows: int
    properties: list[PlyProperty]


class Header(NamedTuple):
    """The parsed header; `byte_order` is empty for text, `length` is the offset of the body."""

    byte_order: str
    elements: list[PlyElement]
    length: int


def parse_header(data: bytes) -> Header:
    """Parse the header. Raises ReadError with the line number."""
    first = re.match(rb"ply[ \t]*(\r\n|\n|\r)", data)
    if first is None:
        raise ReadError("this is not a PLY file: its first line is not 'ply'")
    end = re.compile(rb"(?:\r\n|\n|\r)end_header[ \t]*(?:" + first[1] + rb"|\Z)").search(data)
    if end is None:
        raise ReadError("the PLY header has no line 'end_header': the file is truncated, or not a PLY file")
    byte_order, elements = None, list[PlyElement]()
    for line in re.finditer(rb"[^\r\n]+", data[first.end() : end.start()]):
        words = [(_decoded(word[0]), word.span()) for word in re.finditer(rb"\S+", line[0])]
        match [word for word, _ in words]:
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, _] if name in BYTE_ORDERS:
                byte_order = BYTE_ORDERS[name]
            case ["element", name, count] if count.isascii() and count.isdigit() and len(count) < 19:
                elements.append(PlyElement(name, int(count), []))
            case ["property", "list", count_kind, kind, name] if (
                elements and kind in PLY_TYPES and count_kind not in LONG and PLY_TYPES.get(count_kind, "f")[0] in "iu"
            ):
                elements[-1].properties.append(PlyProperty(name, PLY_TYPES[kind], PLY_TYPES[count_kind], (0, 0)))
            case ["property", kind, name] if elements and kind in PLY_TYPES:
                begin, stop = words[1][1]
                at = first.end() + line.start()
                elements[-1].properties.append(PlyProperty(name, PLY_TYPES[kind], None, (at + begin, at + stop)))
            case _:
                number = 1 + len(re.findall(rb"\r\n|\n|\r", data[: first.end() + line.start()]))
                text = _decoded(line[0])[:60]
                raise ReadError(f"line {number} of the PLY header cannot be understood: {text!r}")
    if byte_order is None:
        raise ReadError("the PLY header has no line 'format ascii 1.0' or 'format binary_… 1.0'")
    repeated = [name for name, count in Counter(element.name for element in elements).items() if count > 1]
    if repeated:
        raise ReadError(f"the PLY header has more than one element {repeated[0]!r}: give each its own name")
    return Header(byte_order, elements, end.end())


def _decoded(word: bytes) -> str:
    try:
        return word.decode()
    except UnicodeDecodeError:
        return word.decode("latin-1")
