"""A figure: pictures, text and frames at their places, as pixels."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.render.color import INK, Image, blend, paper
from cascadenorm.render.pillow import text_coverage

DPI = 300
"""Pixels an inch, where a file says how large a figure is."""

Color = tuple[float, float, float]


class Picture(NamedTuple):
    """Pixels at a place, in pixels of the figure from its upper left."""

    image: Image
    left: int
    top: int


class Text(NamedTuple):
    """A line of text.

    Parameters
    ----------
    text
        ASCII and °; the font has boxes for other characters.
    x, y
        Where its middle lies, or its beginning; y in the middle of the capital letters.
    size
        Height of a capital letter.
    room
        Length that there is for it; what does not fit is cut.
    begins
        Whether x is the beginning of the line.
    upward
        Whether the line runs from bottom to top.
    """

    text: str
    x: float
    y: float
    size: float
    room: int
    begins: bool = False
    upward: bool = False


class Frame(NamedTuple):
    """The outline of a rectangle; half of the line lies within."""

    left: float
    top: float
    width: float
    height: float
    color: Color = INK
    line: float = 1.0


class Figure(NamedTuple):
    """Pictures, text and frames, drawn in their order on a sheet of some pixels."""

    width: int
    height: int
    items: Sequence[Picture | Text | Frame]

    def moved(self, left: int, top: int) -> list[Picture | Text | Frame]:
        """Return the items at another place."""
        return [_moved(item, left, top) for item in self.items]


def rasterized(figure: Figure, *, transparent: bool = False) -> Image:
    """Draw a figure as pixels."""
    sheet = paper(figure.height, figure.width, transparent=transparent)
    for item in figure.items:
        if isinstance(item, Picture):
            _paste(sheet, item)
        elif isinstance(item, Text):
            _write(sheet, item)
        else:
            _outline(sheet, item)
    return sheet


def stacked(figures: Sequence[Figure], *, gap: int = 12, side_by_side: bool = False, centered: bool = True) -> Figure:
    """Join figures from the top to the bottom, or from left to right, centred on one line or from one edge."""
    along = [figure.width if side_by_side else figure.height for figure in figures]
    across = [figure.height if side_by_side else figure.width for figure in figures]
    items: list[Picture | Text | Frame] = []
    place = 0
    for figure, length, breadth in zip(figures, along, across, strict=True):
        beside = (max(across) - breadth) // 2 if centered else 0
        items += figure.moved(*((place, beside) if side_by_side else (beside, place)))
        place += length + gap
    total, broadest = max(place - gap, 0), max(across, default=0)
    return Figure(*((total, broadest) if side_by_side else (broadest, total)), items)


def _moved(item: Picture | Text | Frame, left: int, top: int) -> Picture | Text | Frame:
    if isinstance(item, Text):
        return item._replace(x=item.x + left, y=item.y + top)
    if isinstance(item, Picture):
        return item._replace(left=item.left + left, top=item.top + top)
    return item._replace(left=item.left + left, top=item.top + top)


def _paste(sheet: Image, item: Picture) -> None:
    height, width, channels = item.image.shape
    there = sheet[item.top : item.top + height, item.left : item.left + width]
    there[..., :channels] = item.image
    there[..., channels:] = 255


def _write(sheet: Image, item: Text) -> None:
    coverage = text_coverage(item.text, size=item.size, room=item.room)
    height, width = coverage.shape
    if item.upward:
        coverage, width, height = np.rot90(coverage), height, width
    left = round(item.x) if item.begins and not item.upward else round(item.x - width / 2)
    top = round(item.y) - height if item.begins and item.upward else round(item.y - height / 2)
    first, start = max(top, 0), max(left, 0)
    there = sheet[first : top + height, start : left + width]
    blend(there, INK, coverage[first - top :, start - left :][: there.shape[0], : there.shape[1]])


def _outline(sheet: Image, item: Frame) -> None:
    """Cover the pixels of the line, those at its ends in part."""
    rows, columns = np.arange(sheet.shape[0]), np.arange(sheet.shape[1])
    half = item.line / 2
    outside, inside = (
        _covered(rows, item.top - grow, item.top + item.height + grow)[:, None]
        * _covered(columns, item.left - grow, item.left + item.width + grow)
        for grow in (half, -half)
    )
    blend(sheet, item.color, outside - inside)


def _covered(pixels: NDArray[np.int_], start: float, stop: float) -> NDArray[np.float64]:
    """Share of each pixel that lies between two places."""
    return np.asarray(np.clip(np.minimum(pixels + 1, stop) - np.maximum(pixels, start), 0, 1))
