"""sRGB bytes, linear light, and colours that stand for values."""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Image = NDArray[np.uint8]
"""(height, width, 3) sRGB, or (height, width, 4) with coverage."""

PAPER = (1.0, 1.0, 1.0)
INK = (0.20, 0.22, 0.26)
UNKNOWN = (0.62, 0.62, 0.62)
"""Where there is no value."""

STEPS = 256
_VIRIDIS = "44015448186a472d7b4240863b528b33638d2c728e26828e21918c1f9f8827ad813dbc745cc86381d34daadc32d5e21afde725"
"""Every sixteenth colour of viridis (van der Walt & Smith 2015, CC0)."""


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
        Two hues on both sides of the middle, in place of one scale from dark to light.
    """

    values: NDArray[np.float64]
    at: Literal["face", "vertex"]
    limits: tuple[float, float]
    signed: bool = False


def color_map(*, signed: bool) -> NDArray[np.float64]:
    """Return STEPS sRGB colours from the least value to the largest, perceptually even and fit for the colour-blind.

    Viridis, or for signed values straight lines in OKLab (Ottosson 2020) from blue over light grey to orange.
    """
    place = np.linspace(0, 1, STEPS)
    if not signed:
        stops = np.array([int(pair, 16) for pair in map("".join, zip(*[iter(_VIRIDIS)] * 2, strict=True))]) / 255
        rows = stops.reshape(-1, 3)
        return np.stack([np.interp(place * (len(rows) - 1), range(len(rows)), c) for c in rows.T], axis=1)
    away = np.abs(2 * place - 1)
    hue = np.radians(np.where(place < 0.5, 250, 55))
    lab = np.stack([0.93 - 0.45 * away, 0.14 * away * np.cos(hue), 0.14 * away * np.sin(hue)], axis=1)
    cones = (
        lab
        @ np.array(
            [(1, 0.3963377774, 0.2158037573), (1, -0.1055613458, -0.0638541728), (1, -0.0894841775, -1.291485548)]
        ).T
    )
    light = (
        cones**3
        @ np.array(
            [
                (4.0767416621, -3.3077115913, 0.2309699292),
                (-1.2684380046, 2.6097574011, -0.3413193965),
                (-0.0041960863, -0.7034186147, 1.707614701),
            ]
        ).T
    )
    return encoded(light) / 255


def linear(color: ArrayLike) -> NDArray[np.float64]:
    """SRGB to linear light."""
    c = np.asarray(color, float)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def encoded(light: NDArray[np.float64]) -> Image:
    """Linear light to sRGB bytes."""
    c = np.clip(light, 0, 1)
    c = np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * c), np.uint8)


def paper(height: int, width: int, *, transparent: bool = False) -> Image:
    """Return an empty picture, white or without any coverage."""
    image = np.full((height, width, 4 if transparent else 3), 255, np.uint8)
    image[..., 3:] = 0
    return image


def blend(image: Image, color: ArrayLike, coverage: NDArray[np.float64]) -> None:
    """Paint an sRGB colour over a picture in place where `coverage`, (height, width) from 0 to 1, says so."""
    part = coverage[..., None]
    if image.shape[2] == 4:
        below = image[..., 3:] / 255 * (1 - part)
        whole = below + part
        part = np.divide(part, whole, out=np.zeros_like(part), where=whole > 0)
        image[..., 3] = np.rint(255 * whole[..., 0])
    mixed = image[..., :3] * (1 - part) + 255 * np.asarray(color, float) * part
    image[..., :3] = np.rint(mixed)
