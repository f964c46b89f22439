"""Several pictures on one sheet, with captions and a legend."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cascadenorm.render.color import INK, PAPER, Image, encoded, error_colors, linear
from cascadenorm.render.text import lettering


def error_legend(*, limit: float, unit: str, size: tuple[int, int]) -> Image:
    """Draw the bar that goes with `error_colors`, upright, with five marks.

    Parameters
    ----------
    limit : error at the upper end, in the unit that is written
    unit : written after each number, such as °
    size : width and height in pixels
    """
    width, height = size
    picture = np.broadcast_to(linear(PAPER), (height, width, 3)).copy()
    letter = max(9, height // 50)
    top, bottom, bar = 3 * letter, height - 3 * letter, 2 * letter
    levels = 1 - (np.arange(top, bottom) + 0.5 - top) / (bottom - top)
    picture[top:bottom, :bar] = linear(error_colors(levels, limit=1.0))[:, None]
    for level in np.linspace(0, 1, 5):
        row = bottom - 1 - round(level * (bottom - top - 1))
        picture[row, :bar] = linear(INK)
        _write(picture, f"{level * limit:g}{unit}", left=bar + letter // 2, middle=row, size=letter)
    return encoded(picture)


def side_by_side(images: Sequence[Image], captions: Sequence[str] = (), *, gap: int = 12) -> Image:
    """Join pictures from left to right, centred on one line, each above its caption.

    Parameters
    ----------
    images : (h, w, 3) pictures, not necessarily of one size
    captions : as many lines of text, or none; an empty line leaves its place free
    gap : pixels between two pictures
    """
    if not images or (captions and len(captions) != len(images)):
        raise ValueError(f"{len(images)} pictures and {len(captions)} captions; there must be as many")
    tallest = max(len(image) for image in images)
    widest = max(image.shape[1] for image in images)
    letter = max(10, min(tallest, widest) // 36)
    foot = 3 * letter if captions else 0
    width = sum(image.shape[1] for image in images) + gap * (len(images) - 1)
    sheet = np.broadcast_to(encoded(linear(PAPER)), (tallest + foot, width, 3)).copy()
    left = 0
    for k, image in enumerate(images):
        top = (tallest - len(image)) // 2
        sheet[top : top + len(image), left : left + image.shape[1]] = image
        if captions and captions[k]:
            strip = np.broadcast_to(linear(PAPER), (foot, image.shape[1], 3)).copy()
            _write(strip, captions[k], left=None, middle=foot // 2 - letter // 4, size=letter)
            sheet[tallest:, left : left + image.shape[1]] = encoded(strip)
        left += image.shape[1] + gap
    return sheet


def _write(picture: NDArray[np.float64], text: str, *, left: int | None, middle: int, size: float) -> None:
    """Set a line of text into a linear picture, in place; centred if `left` is None, cut where the picture ends."""
    coverage = lettering(text, size=size)
    height, width = coverage.shape
    top = max(0, middle - round(0.5 * height))
    left = max(0, (picture.shape[1] - width) // 2) if left is None else left
    window = picture[top : top + height, left : left + width]
    alpha = coverage[: window.shape[0], : window.shape[1], None]
    window += alpha * (linear(INK) - window)
