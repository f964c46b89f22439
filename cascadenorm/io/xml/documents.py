"""XML documents as elements with known byte positions, so that numbers can be replaced without other changes."""

import re
from collections.abc import Callable, Iterator
from typing import NoReturn
from xml.parsers import expat

from cascadenorm.errors import ReadError, reason
from cascadenorm.io.text.text import Edit

TAG = re.compile(rb"""<[^\s/>]+(?:\s+[^\s=<>/]+\s*=\s*(?:"[^"]*"|'[^']*'))*\s*(/?)>""")
ATTRIBUTE = re.compile(rb"""\s+([^\s=<>/]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
UTF_16 = (b"\xff\xfe", b"\xfe\xff", b"<\0", b"\0<")


class Element:
    """An element: its name without namespace, and attributes, with a namespace and a space if they have one."""

    def __init__(self, data: bytes, name: str, attributes: dict[str, str], at: int) -> None:
        self.name, self.attributes, self.children = name, attributes, list[Element]()
        self._data, self._at, self._end = data, at, at

    @property
    def span(self) -> tuple[int, int]:
        """Begin and end of the content in the document."""
        tag = TAG.match(self._data, self._at)
        if tag is None:
            raise ReadError(f"the element {self.name!r} is not valid XML: export the file again")
        return (tag.end(), tag.end()) if tag[1] else (tag.end(), self._end)

    @property
    def numbers(self) -> bytes:
        """The content as plain text. Raises ReadError if it is not plain text."""
        begin, end = self.span
        content = self._data[begin:end]
        if b"<" in content or b"&" in content:
            raise ReadError(f"the element {self.name!r} holds more than numbers: export the file again")
        return content

    def all(self, *path: str) -> "list[Element]":
        """Return the elements at a path of names below this one."""
        name, *rest = path
        found = [child for child in self.children if child.name == name]
        return [element for child in found for element in child.all(*rest)] if rest else found

    def first(self, *path: str) -> "Element | None":
        """Return the first element at a path of names below this one, or None."""
        return next(iter(self.all(*path)), None)

    def within(self) -> "Iterator[Element]":
        """Return this element and all its descendants."""
        waiting = [self]
        while waiting:
            element = waiting.pop()
            yield element
            waiting += reversed(element.children)


def parse(data: bytes, start: Callable[[str, dict[str, str], int], None], end: Callable[[str, int], None]) -> None:
    """Call `start` with the full name, attributes and offset of each element, and `end` with its name and offset."""
    if data.startswith(UTF_16):
        raise ReadError("the XML of this file is UTF-16, which is not supported: save it as UTF-8")
    parser = expat.ParserCreate(namespace_separator=" ")
    parser.StartDoctypeDeclHandler = _refuse_types
    parser.StartElementHandler = lambda name, attributes: start(name, attributes, parser.CurrentByteIndex)
    parser.EndElementHandler = lambda name: end(name, parser.CurrentByteIndex)
    try:
        parser.Parse(data, True)
    except (ReadError, KeyError):  # raised by one of the functions
        raise
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise ReadError(f"the XML of this file is damaged: {reason(error)}") from None


def tree_of(data: bytes) -> Element:
    """Return the root of a document. Raises ReadError for invalid XML."""
    top = Element(data, "", {}, 0)
    now = [top]

    def start(name: str, attributes: dict[str, str], at: int) -> None:
        element = Element(data, name.rpartition(" ")[2], attributes, at)
        now[-1].children.append(element)
        now.append(element)

    def end(_: str, at: int) -> None:
        now.pop()._end = at

    parse(data, start, end)
    return top.children[0]


def attribute_edits(data: bytes, at: int, values: dict[bytes, bytes]) -> list[Edit]:
    """Return the edits that change attributes of the element at a byte offset."""
    edits = []
    place = at + 1
    while data[place : place + 1] not in (b" ", b"\t", b"\r", b"\n", b""):
        place += 1
    while found := ATTRIBUTE.match(data, place):
        if found[1] in values:
            edits.append((*found.span(2 if found[2] is not None else 3), values[found[1]]))
        place = found.end()
    if len(edits) < len(values):
        raise ReadError("an element of this file is not valid XML: export the file again")
    return edits


def _refuse_types(*_: object) -> NoReturn:
    raise ReadError("the XML of this file declares a document type, which is not supported: export it again")
