"""sRGB bytes, linear light, and colours that stand for values."""

import json
from functools import cache
from importlib.resources import files
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Image = NDArray[np.uint8]
"""(height, width, 3) sRGB, or (height, width, 4) with coverage."""

PAPER = (1.0, 1.0, 1.0)
STEPS = 256
"""Colours of a heat map."""


class HeatMap(NamedTuple):
    """Values on a mesh, to be seen as colours.

    Parameters
    ----------
    values
        (m,) or (n,), one a face or one a vertex; NaN where there is none.
    at
        Which of the two.
    limits
        Values at the two ends of the colours; those beyond have the colour of the end.
    signed
        Use two hues on both sides of zero instead of one scale from light to dark.
    """

    values: NDArray[np.float64]
    at: Literal["face", "vertex"]
    limits: tuple[float, float]
    signed: bool = False


def color_map(*, signed: bool) -> NDArray[np.float64]:
    """Return STEPS sRGB colours from the lowest value to the highest, distinguishable with colour blindness.

    Unsigned values run from ivory at zero to dark blue, signed ones from blue over light grey to orange.
    """
    return named_colors("diverging" if signed else "sequential")


@cache
def named_colors(name: str) -> NDArray[np.float64]:
    """Return (k, 3) sRGB colours from 0 to 1 of `colors.json`, the table that the viewer in the browser has as well."""
    table = json.loads(files(__package__).joinpath("colors.json").read_text(encoding="utf-8"))
    colors = np.frombuffer(bytes.fromhex(table[name]), np.uint8).reshape(-1, 3) / 255
    colors.flags.writeable = False
    return colors


def linear(color: ArrayLike) -> NDArray[np.float64]:
    """SRGB to linear light."""
    c = np.asarray(color, float)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def encoded(light: NDArray[np.float64]) -> Image:
    """Linear light to sRGB bytes."""
    c = np.clip(light, 0, 1)
    c = np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * c), np.uint8)
