"""Convert between sRGB and linear light, and map values to colours."""

import json
from functools import cache
from importlib.resources import files
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Image = NDArray[np.uint8]  # (height, width, 3) sRGB, or (height, width, 4) with an alpha channel

PAPER = (1.0, 1.0, 1.0)
COLOR_STEPS = 256  # number of colours in a heat map


class HeatMap(NamedTuple):
    """Values on a mesh, to be shown as colours."""

    values: NDArray[np.float64]  # (m,) or (n,) values of faces or vertices; NaN if unknown
    at: Literal["face", "vertex"]  # whether the values belong to faces or vertices
    limits: tuple[float, float]  # values at both ends of the colour scale; values beyond are clipped
    signed: bool = False  # use a diverging scale around zero instead of a sequential one


def color_map(*, signed: bool) -> NDArray[np.float64]:
    """Return COLOR_STEPS sRGB colours from the lowest to the highest value, suitable for colour-blind readers.

    Unsigned values range from ivory at zero to dark blue, and signed values from blue through light grey to orange.
    """
    return named_colors("diverging" if signed else "sequential")


@cache
def named_colors(name: str) -> NDArray[np.float64]:
    """Return (k, 3) sRGB colours, 0 to 1, from `colors.json`, which the browser viewer uses as well."""
    table = json.loads(files(__package__).joinpath("colors.json").read_text(encoding="utf-8"))
    colors = np.frombuffer(bytes.fromhex(table[name]), np.uint8).reshape(-1, 3) / 255
    colors.flags.writeable = False
    return colors


def linear(color: ArrayLike) -> NDArray[np.float64]:
    """Convert sRGB to linear light."""
    c = np.asarray(color, float)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def encoded(light: NDArray[np.float64]) -> Image:
    """Convert linear light to sRGB bytes."""
    c = np.clip(light, 0, 1)
    c = np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * c), np.uint8)
