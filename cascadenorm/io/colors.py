"""Colours and texture coordinates of vertices in a common form."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.io.text.text import Text
from cascadenorm.io.text.tokenizer import Offsets

CHANNELS = ("red", "green", "blue", "alpha")
TEXTURE = ("s", "t")
"""Names of texture coordinates among the vertex values."""


def from_words(text: Text, words: Offsets) -> dict[str, NDArray[Any]]:
    """Parse words (k, 3 or 4) as channels, in bytes. Values are 0 … 255, or fractions if all are below 2."""
    values = text.numbers(words)
    fractions = not (values >= 2).any()
    with np.errstate(invalid="ignore", over="ignore"):
        scaled = np.nan_to_num(np.clip(np.rint(values * 255 if fractions else values), 0, 255)).astype(np.uint8)
    return dict(zip(CHANNELS, scaled.T, strict=False))


def channels(values: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[np.uint8]]:
    """Return the channels among attributes as bytes; empty without red, green and blue."""
    if any(name not in values for name in CHANNELS[:3]):
        return {}
    found = {name: values[name] for name in CHANNELS if name in values}
    return {name: _as_byte(value) for name, value in found.items()}


def as_bytes(fractions: NDArray[Any]) -> NDArray[np.uint8]:
    """Convert channels from fractions to bytes."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.nan_to_num(np.clip(np.rint(fractions * 255), 0, 255)).astype(np.uint8))


class Look(NamedTuple):
    """Colours (k, 3) as fractions in float32, texture coordinates (k, 2), and the names of the values they contain."""

    colors: NDArray[Any] | None
    texture: NDArray[Any] | None
    names: tuple[str, ...]

    @classmethod
    def of(cls, values: Mapping[str, NDArray[Any]]) -> "Look":
        """Return the colours and texture coordinates among the values of vertices; None for missing ones."""
        rgb = [channel.astype(np.float32) for name, channel in channels(values).items() if name != "alpha"]
        st = [values[name] for name in TEXTURE] if all(name in values for name in TEXTURE) else []
        colors = np.stack(rgb, axis=1) / np.float32(255) if rgb else None
        return cls(colors, np.stack(st, axis=1) if st else None, CHANNELS[: len(rgb)] + TEXTURE[: len(st)])


def _as_byte(values: NDArray[Any]) -> NDArray[np.uint8]:
    if values.dtype == np.uint8:
        return values
    largest = 1 if values.dtype.kind == "f" else np.iinfo(values.dtype).max
    return np.asarray(np.nan_to_num(np.clip(np.rint(values * (255 / largest)), 0, 255)).astype(np.uint8))
