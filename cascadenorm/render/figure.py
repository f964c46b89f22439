"""Lay out pictures, captions, enlarged parts and colour bars, with matplotlib except for a single row in a page."""

import io
import re
from base64 import b64decode, b64encode
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import PIL.Image

from cascadenorm.render.color import Image, color_map
from cascadenorm.render.encoding import webp
from cascadenorm.render.style import ACCENTS, DPI, FONT, INK, drawing, text_of, warn_of_missing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GAP = 12  # space between panels in pixels
ALIGNED = 1e-3
"""Amount in pixels by which a picture is smaller than its place, which prevents resampling due to rounding."""


class Inset(NamedTuple):
    """An enlarged square part of a picture; its center and width are fractions of the picture from the upper left."""

    x: float
    y: float
    width: float
    image: Image


class Panel(NamedTuple):
    """A picture with its caption and, below it, its enlarged parts, which are framed in both places."""

    image: Image
    caption: str = ""
    insets: Sequence[Inset] = ()

    @property
    def height(self) -> int:
        """Height of the pictures in pixels."""
        return len(self.image) + max((GAP + len(inset.image) for inset in self.insets), default=0)


class Bar(NamedTuple):
    """The colour bar of a heat map."""

    label: str  # description of the values, with their unit
    limits: tuple[float, float]  # values at the lower and upper end
    signed: bool = False  # as in `HeatMap`


def montage(rows: Sequence[Sequence[Panel]], *, bar: Bar | None = None) -> "Figure":
    """Arrange panels in rows, without changing any pixel of their pictures, and a colour bar beside the last row."""
    size = _font_size([panel for row in rows for panel in row])
    widths = [sum(panel.image.shape[1] + GAP for panel in row) - GAP for row in rows]
    heights = [max(panel.height for panel in row) for row in rows]
    feet = [2 * size if any(panel.caption for panel in row) else GAP * (row is not rows[-1]) for row in rows]
    place = widths[-1] + 2 * GAP
    width, height = max(*widths, place + 8 * size if bar else 0), sum(heights) + sum(feet)
    with drawing("".join(panel.caption for row in rows for panel in row) + (bar.label if bar else "")):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        figure = Figure(((width + ALIGNED) / DPI, (height + ALIGNED) / DPI))
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(height, 0))  # in pixels from the upper left
        axes.axis("off")
        top = 0
        for row, tall, foot in zip(rows, heights, feet, strict=True):
            left = 0
            for panel in row:
                _draw_panel(axes, panel, left, top)
                _write(axes, panel, left + panel.image.shape[1] / 2, top + tall + foot / 2, _points(size))
                left += panel.image.shape[1] + GAP
            top += tall + foot
        if bar:
            bottom, long = top - feet[-1] - size, max(heights[-1] - 2 * size, 1)
            _draw_bar(figure, bar, (place / width, 1 - bottom / height, size / width, long / height), size)
    return figure


def _font_size(panels: Sequence[Panel]) -> int:
    """Return the font size in pixels."""
    shortest: int = min(side for panel in panels for side in panel.image.shape[:2])
    return max(18, shortest // 25)


def _draw_panel(axes: "Axes", panel: Panel, left: int, top: int) -> None:
    """Draw a picture and its enlarged parts."""
    height, width = panel.image.shape[:2]
    line = max(2.0, min(height, width) / 150)
    _draw_image(axes, panel.image, left, top)
    across = left
    for number, inset in enumerate(panel.insets):
        color, side = ACCENTS[number % len(ACCENTS)], inset.width * width
        corner = left + inset.x * width - side / 2, top + inset.y * height - side / 2
        _draw_frame(axes, *corner, side, side, line, color)
        tall, wide = inset.image.shape[:2]
        below = top + height + GAP
        _draw_image(axes, inset.image, across, below)
        _draw_frame(axes, across + line / 2, below + line / 2, wide - line, tall - line, line, color)
        across += wide + GAP


def _draw_image(axes: "Axes", image: Image, left: int, top: int) -> None:
    height, width = image.shape[:2]
    place = (left + ALIGNED, left + width - ALIGNED, top + height - ALIGNED, top + ALIGNED)
    axes.imshow(image, extent=place, aspect="auto", interpolation="none")


def _draw_frame(axes: "Axes", left: float, top: float, width: float, height: float, line: float, color: str) -> None:
    from matplotlib.patches import Rectangle

    corner, line = (left, top), _points(line)
    frame = Rectangle(corner, width, height, fill=False, edgecolor=color, linewidth=line, joinstyle="miter")
    axes.add_patch(frame)


def _write(axes: "Axes", panel: Panel, x: float, y: float, size: float) -> None:
    """Write the caption of a panel on one line, abbreviated in the middle if it is too long."""
    line = "".join(character if character.isprintable() else "\ufffd" for character in panel.caption)
    written = axes.text(x, y, line, size=size, ha="center", va="center")
    kept = len(line)
    while (length := written.get_window_extent().width) > panel.image.shape[1] and kept > 2:
        kept = min(kept - 1, int(kept * panel.image.shape[1] / length))
        written.set_text(f"{line[: kept // 2]}…{line[len(line) - kept // 2 :]}")


def _draw_bar(figure: "Figure", bar: Bar, place: tuple[float, float, float, float], size: int) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    colors = ScalarMappable(Normalize(*bar.limits), ListedColormap(color_map(signed=bar.signed)))
    drawn = figure.colorbar(colors, cax=figure.add_axes(place))
    drawn.ax.patch.set_visible(False)
    drawn.outline.set_linewidth(_points(1))
    drawn.ax.tick_params(labelsize=_points(size), width=_points(1), length=_points(size / 4), pad=_points(size / 4))
    drawn.ax.yaxis.get_offset_text().set_fontsize(_points(size))
    drawn.set_label(bar.label, size=_points(size))


def _points(pixels: float) -> float:
    return pixels * 72 / DPI


def pixels(figure: "Figure", *, transparent: bool = False) -> Image:
    """Render a figure to pixels on a white or transparent background."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    text = text_of(figure)
    warn_of_missing(text)
    figure.patch.set_visible(not transparent)
    with drawing(text):
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    drawn = np.asarray(canvas.buffer_rgba())
    return drawn.copy() if transparent else drawn[..., :3].copy()


def pdf(figure: "Figure", *, transparent: bool = False) -> bytes:
    """Return a figure as a PDF file of one page with embedded fonts, on a white or transparent background."""
    warn_of_missing(text_of(figure))
    return _saved(figure, "pdf", {"CreationDate": None, "Creator": None, "Producer": None}, transparent=transparent)


def svg(figure: "Figure", *, transparent: bool = False) -> bytes:
    """Return a figure as an SVG file on a white or transparent background; fonts are not embedded."""
    about = {"Date": None, "Creator": None, "Format": None, "Type": None}
    written = _saved(figure, "svg", about, transparent=transparent)
    return written.replace(b"image-rendering:crisp-edges;image-rendering:pixelated", b"")


def inline_svg(figure: "Figure", about: str) -> str:
    """Return a figure as an inline HTML element with WebP pictures; text and lines use the colour of the page.

    The alternative text describes the figure.
    """
    text = svg(figure, transparent=True).decode()
    text = re.sub(r"data:image/png;base64,([^\"]+)", lambda found: _as_webp(found[1]), text[text.index("<svg") :])
    text = re.sub(r' id="[a-z0-9_.]+_\d+"', "", text)  # a page may contain several figures
    text = text.replace(INK, "currentColor").replace(f"'{FONT}'", f"system-ui, '{FONT}'")
    return text.replace("<svg", f'<svg role="img" aria-label="{escape(about)}"', 1)


def inline_row(panels: Sequence[Panel], about: str) -> str:
    """Return pictures with captions side by side as an inline HTML element, like `inline_svg`, without matplotlib."""
    size = _font_size(panels)
    height = max(len(panel.image) for panel in panels) + 2 * size
    parts, left = list[str](), 0
    for panel in panels:
        tall, wide = panel.image.shape[:2]
        parts.append(f'<image href="{_webp_url(panel.image)}" x="{left}" width="{wide}" height="{tall}"/>')
        parts.append(f'<text x="{left + wide / 2:g}" y="{height - 0.7 * size:g}">{escape(panel.caption)}</text>')
        left += wide + GAP
    text = f'font-size="{size}" font-family="system-ui, sans-serif" text-anchor="middle" fill="currentColor"'
    box = f'xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {left - GAP} {height}"'
    return f'<svg role="img" aria-label="{escape(about)}" {box} {text}>{"".join(parts)}</svg>'


def _as_webp(data: str) -> str:
    """Convert the base64 data of a PNG file to a WebP data URL."""
    with PIL.Image.open(io.BytesIO(b64decode(data))) as image:
        return _webp_url(np.asarray(image))


def _webp_url(image: Image) -> str:
    return f"data:image/webp;base64,{b64encode(webp(image)).decode('ascii')}"


def _saved(figure: "Figure", kind: str, about: dict[str, None], *, transparent: bool) -> bytes:
    file = io.BytesIO()
    figure.patch.set_visible(not transparent)
    with drawing(text_of(figure)):
        figure.savefig(file, format=kind, metadata=about)
    return file.getvalue()
