"""Several pictures in one, with captions and a legend."""

from collections.abc import Sequence

import numpy as np

from cascadenorm.render.color import INK, PAPER, Image, encoded, error_colors, linear
from cascadenorm.render.pillow import add_text


def error_legend(*, limit: float, unit: str, size: tuple[int, int]) -> Image:
    """Draw the bar that goes with `error_colors`, upright, with five marks.

    Parameters
    ----------
    limit : error at the upper end, in the unit that is written
    unit : written after each number, such as °
    size : width and height in pixels
    """
    width, height = size
    letter = max(9, height // 50)
    top, bottom, bar = 3 * letter, height - 3 * letter, 2 * letter
    picture = _paper(height, width)
    levels = 1 - (np.arange(top, bottom) + 0.5 - top) / (bottom - top)
    picture[top:bottom, :bar] = encoded(linear(error_colors(levels, limit=1.0)))[:, None]
    for level in np.linspace(0, 1, 5):
        row = bottom - 1 - round(level * (bottom - top - 1))
        picture[row, :bar] = encoded(linear(INK))
        picture = add_text(picture, f"{level * limit:g}{unit}", left=bar + letter // 2, middle=row, size=letter)
    return picture


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
    figure, left = _paper(tallest + foot, width), 0
    for k, image in enumerate(images):
        top, columns = (tallest - len(image)) // 2, slice(left, left + image.shape[1])
        figure[top : top + len(image), columns] = image
        if captions and captions[k]:
            strip = _paper(foot, image.shape[1])
            figure[tallest:, columns] = add_text(strip, captions[k], left=None, middle=foot // 2, size=letter)
        left += image.shape[1] + gap
    return figure


def _paper(height: int, width: int) -> Image:
    """Return an empty picture."""
    return np.broadcast_to(encoded(linear(PAPER)), (height, width, 3)).copy()
