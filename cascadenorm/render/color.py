"""sRGB bytes, linear light, and colours that stand for an error."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Image = NDArray[np.uint8]
"""(height, width, 3) sRGB."""

PAPER = (1.0, 1.0, 1.0)
INK = (0.20, 0.22, 0.26)
_ERROR_COLORS = ((0.88, 0.90, 0.93), (0.98, 0.82, 0.45), (0.95, 0.49, 0.22), (0.74, 0.15, 0.15), (0.33, 0.03, 0.14))


def error_colors(error: NDArray[np.float64], *, limit: float) -> NDArray[np.float64]:
    """Return one sRGB colour for each error: pale at 0, darker all the way to `limit` and beyond."""
    place = np.clip(error / limit, 0, 1) * (len(_ERROR_COLORS) - 1)
    return np.stack([np.interp(place, range(len(_ERROR_COLORS)), c) for c in zip(*_ERROR_COLORS, strict=True)], axis=-1)


def linear(color: ArrayLike) -> NDArray[np.float64]:
    """SRGB to linear light."""
    c = np.asarray(color, float)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def encoded(light: NDArray[np.float64]) -> Image:
    """Linear light to sRGB bytes."""
    c = np.clip(light, 0, 1)
    c = np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * c), np.uint8)
