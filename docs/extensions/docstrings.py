"""Docstrings of this package as reStructuredText.

Sections are underlined as in numpydoc. An entry of a section is a name on a line of its own, with its description
indented below; types are in the signature.
"""

import re
from itertools import pairwise
from typing import Any


def with_definitions(lines: list[str]) -> list[str]:
    """Return the lines of a docstring with a heading for each section and a definition for each entry."""
    out: list[str] = []
    title = ""
    for line, after in pairwise([*map(plain, lines), ""]):
        if line and after and set(after) == {"-"}:
            title = line
            out += ["", f".. rubric:: {title}", ""]
        elif line and set(line) == {"-"}:
            continue
        elif title and line and not line.startswith(" ") and after.startswith(" "):
            out.append(f"``{line}``")
        else:
            out.append(line)
    return [*out, ""]


def plain(line: str) -> str:
    """Return a line in which stars, bars and underscores stand for themselves; code in backticks stays as it is."""
    parts = re.split(r"(`+[^`]+`+)", line)
    return "".join(
        _linked(re.sub(r"([*|]|_\b)", r"\\\1", part)) if i % 2 == 0 else part for i, part in enumerate(parts)
    )


def _linked(text: str) -> str:
    """Let the types of arrays link to numpy."""
    return re.sub(r"\b((?:float|u?int)(?:8|32|64))\b", r":class:`\1 <numpy.\1>`", text)


def setup(app: Any) -> dict[str, bool]:
    def process(app: Any, what: str, name: str, item: Any, options: Any, lines: list[str]) -> None:
        lines[:] = with_definitions(lines)

    app.connect("autodoc-process-docstring", process)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
