"""Self-contained HTML pages of text and a picture, with the viewer where scripts run."""

import json
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from typing import Any, NamedTuple

PAGE_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
"""Content security policy: the page loads nothing from elsewhere."""

CODE, CODE_IN_HTML = re.compile("`([^`<>]+)`"), r"<code>\1</code>"


class Tile(NamedTuple):
    """A figure at the top of a page."""

    label: str
    values: tuple[str, ...]  # one value, or those before and after
    note: str = ""  # such as the unit


def page(
    title: str,
    summary: Iterable[str],
    sections: Iterable[tuple[str, str]],
    *,
    tiles: Sequence[Tile] = (),
    picture: str = "",
    caption: str = "",
    scene: Mapping[str, Any] | None = None,
) -> str:
    """Return the page: a title, a paragraph for each sentence of the summary, tiles, the viewer, and sections.

    Sections are titles and their HTML. The picture, an SVG element, and its caption stand in for the viewer of the
    scene where scripts do not run. Without a scene, there is no viewer.
    """
    paragraphs = "".join(f"<p>{escape(line)}</p>" for line in summary)
    content = "".join(f"<section><h2>{escape(name)}</h2>{content}</section>" for name, content in sections)
    body = f"""<header class="top"><h1>{escape(title)}</h1>{paragraphs}{_tiles(tiles)}</header>
<main>
{"" if scene is None else _viewer(picture, caption)}
{content}
</main>
{"" if scene is None else _scripts(scene)}"""
    return _document(title, "<body>", body)


def frame_page(scene: Mapping[str, Any], picture: str, caption: str, *, color: str) -> str:
    """Return a page that contains only the viewer, for a frame in another page.

    Color is the quantity that is shown first; "" for none. The other parameters are those of `page`.
    """
    first = "history.replaceState = () => {};"  # a frame has no address of its own
    if color:
        first += f" location.hash = {json.dumps(f'color={color}')};"
    body = f"<main>{_viewer(picture, caption)}</main>\n<script>{first}</script>\n{_scripts(scene)}"
    return _document(caption, '<body class="frame">', body)


def _viewer(picture: str, caption: str) -> str:
    return f'<div id="viewer">{image(picture, caption)}</div>'


def _scripts(scene: Mapping[str, Any]) -> str:
    data = json.dumps(scene, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    return f'<script type="application/json" id="scene">{data}</script>\n<script>{_file("viewer.js")}</script>'


def _document(title: str, tag: str, body: str) -> str:
    return f"""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy" content="{PAGE_POLICY}">
<title>{escape(title)}</title>
<link rel="icon" href="data:,">
<style>{_file("report.css")}</style>
</head>
{tag}
{body}
</body>
</html>
"""


def _file(name: str) -> str:
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def _tiles(tiles: Sequence[Tile]) -> str:
    """Return figures in a row."""
    parts = []
    for label, values, note in tiles:
        value = '<span class="to"> → </span>'.join(f"<span>{escape(one)}</span>" for one in values)
        about = f'<dd class="note">{escape(note)}</dd>' if note else ""
        parts.append(f"<div><dt>{escape(label)}</dt><dd>{value}</dd>{about}</div>")
    return f'<dl class="tiles">{"".join(parts)}</dl>' if parts else ""


def image(picture: str, caption: str) -> str:
    """Return an SVG element with a caption."""
    return f"<figure>{picture}<figcaption>{escape(caption)}</figcaption></figure>"


def table(
    rows: Sequence[Sequence[str]],
    *,
    head: bool = True,
    bold: Collection[tuple[int, int]] = (),
    numbers: bool = False,
    prose: bool = False,
    stacked: bool = False,
) -> str:
    """Return a table; the first cell of each row, and the first row if it is a head, are headings.

    The cells in `bold`, by row and column, are bold. With `numbers`, all columns but the first hold numbers. With
    `prose`, the last column holds sentences, with code in backticks. A phone shows the last column below the other
    cells if it is `stacked` or prose.
    """
    lines = []
    for number, row in enumerate(rows):
        if head and number == 0:
            cells = "".join(f'<th scope="col">{escape(cell)}</th>' for cell in row)
        else:
            cells = f'<th scope="row">{escape(row[0])}</th>' + "".join(
                f"<td><strong>{escape(cell)}</strong></td>" if (number, column) in bold else f"<td>{escape(cell)}</td>"
                for column, cell in enumerate(row[1:], start=1)
            )
        lines.append(f"<tr>{CODE.sub(CODE_IN_HTML, cells) if prose else cells}</tr>")
    start, rest = (f"<thead>{lines[0]}</thead>", lines[1:]) if head else ("", lines)
    kinds = {"numbers": numbers, "prose": prose, "stacked": stacked or prose}
    names = " ".join(name for name, given in kinds.items() if given)
    kind = f' class="{names}"' if names else ""
    return f'<div class="table"><table{kind}>{start}<tbody>{"".join(rest)}</tbody></table></div>'


def folded(title: str, content: str) -> str:
    """Return HTML that is hidden until its title is clicked."""
    return f"<details><summary>{escape(title)}</summary>{content}</details>"


def html_list(lines: Iterable[str]) -> str:
    """Return a list of sentences."""
    return f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>"


def code(text: str) -> str:
    return f"<pre><code>{escape(text)}</code></pre>"
