"""Figures of several pictures: panels with captions and enlarged parts, and the bar of a heat map."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cascadenorm.render.color import STEPS, Image, color_map, paper
from cascadenorm.render.figure import Color, Figure, Frame, Picture, Text, stacked
from cascadenorm.render.pillow import text_length

FRAMES: Sequence[Color] = ((0.84, 0.37, 0.0), (0.0, 0.45, 0.70), (0.0, 0.62, 0.45), (0.80, 0.47, 0.65))
"""Colours of the frames of enlarged parts, after Okabe and Ito: told apart by the colour-blind."""
TICKS = 4
"""Marks that a bar has at least."""


class Inset(NamedTuple):
    """A square part of a picture, enlarged: its middle and its width as shares of the picture from the upper left."""

    x: float
    y: float
    width: float
    image: Image


def panel(image: Image, *, insets: Sequence[Inset] = (), gap: int = 12) -> Figure:
    """Return a picture above its enlarged parts, which are framed in both."""
    height, width, _ = image.shape
    line = max(2.0, min(height, width) / 150)
    items: list[Picture | Text | Frame] = [Picture(image, 0, 0)]
    left, bottom = 0, height
    for number, inset in enumerate(insets):
        color = FRAMES[number % len(FRAMES)]
        side = inset.width * width
        items.append(Frame(inset.x * width - side / 2, inset.y * height - side / 2, side, side, color, line))
        top, (tall, wide) = height + gap, inset.image.shape[:2]
        items += [
            Picture(inset.image, left, top),
            Frame(left + line / 2, top + line / 2, wide - line, tall - line, color, line),
        ]
        left, bottom = left + wide + gap, max(bottom, top + tall)
    return Figure(width, bottom, items)


def side_by_side(panels: Sequence[Image | Figure], captions: Sequence[str] = (), *, gap: int = 12) -> Figure:
    """Join panels from left to right, centred on one line, each above its caption.

    Parameters
    ----------
    panels
        Pictures and figures, not necessarily of one size.
    captions
        As many lines of text, or none; an empty line leaves its place free.
    gap
        Pixels between two panels.
    """
    figures = [one if isinstance(one, Figure) else panel(one) for one in panels]
    if not figures or (captions and len(captions) != len(figures)):
        raise ValueError(
            f"{len(figures)} pictures and {len(captions)} captions; there must be as many captions as pictures"
        )
    joined = stacked(figures, gap=gap, side_by_side=True)
    if not captions:
        return joined
    size = letter_size(max(figure.width for figure in figures), joined.height)
    foot, left, items = 3 * size, 0, list(joined.items)
    for figure, caption in zip(figures, captions, strict=True):
        if caption:
            items.append(Text(caption, left + figure.width / 2, joined.height + foot / 2, size, figure.width))
        left += figure.width + gap
    return Figure(joined.width, joined.height + foot, items)


def letter_size(width: int, height: int) -> int:
    """Return the height of the capital letters that go with a panel, all in pixels."""
    return max(10, min(width, height) // 36)


def color_bar(
    limits: tuple[float, float], *, signed: bool, unit: str, label: str, height: int, letter: int = 10
) -> Figure:
    """Draw the bar that goes with a heat map, upright, with its unit.

    Parameters
    ----------
    limits
        Values at the lower and the upper end.
    signed
        Of the heat map.
    unit
        Of the values, such as °.
    label
        What they are, written along the bar.
    height, letter
        Of the bar, and of a capital letter, in pixels.
    """
    size = letter
    top, bottom, wide = 2 * size, height - 2 * size, 2 * size
    rows = np.rint((1 - (np.arange(top, bottom) + 0.5 - top) / (bottom - top)) * (STEPS - 1)).astype(int)
    bar = paper(bottom - top, wide)
    bar[:] = np.rint(255 * color_map(signed=signed)[rows])[:, None]
    items: list[Picture | Text | Frame] = [
        Picture(bar, 0, top),
        Frame(0.5, top + 0.5, wide - 1, bottom - top - 1),
    ]
    longest, degrees = 0.0, "°" if unit == "°" else ""
    low, high = limits
    values = ticks(low, high)
    for value, number in zip(values, tick_texts(values), strict=True):
        y = bottom - (value - low) / (high - low) * (bottom - top)
        items += [
            Frame(wide, y, size / 3, 0.0),
            Text(f"{number}{degrees}", wide + size / 2, y, size, height, begins=True),
        ]
        longest = max(longest, text_length(f"{number}{degrees}", size=size))
    middle = wide + size + longest + size
    about = label if unit in ("", "°") else f"{label} ({unit})"
    items.append(Text(about, middle, height / 2, size, height, upward=True))
    return Figure(round(middle + 1.5 * size), height, items)


def ticks(low: float, high: float) -> list[float]:
    """Round values between two, at equal distances of 1, 2 or 5 of some power of ten."""
    coarse = (high - low) / TICKS
    power = 10.0 ** np.floor(np.log10(coarse))
    step = max(factor * power for factor in (1, 2, 5) if factor * power <= coarse)
    first, last = int(np.ceil(low / step - 1e-9)), int(np.floor(high / step + 1e-9))
    return [number * step for number in range(first, last + 1)]


def tick_texts(values: Sequence[float]) -> list[str]:
    """Return numbers as text, all with as many decimals as the one that needs most."""
    found = [f"{value:.6g}" for value in values]
    if any("e" in number for number in found):
        return found
    decimals = max((len(number.partition(".")[2]) for number in found), default=0)
    return [f"{value:.{decimals}f}" for value in values]
