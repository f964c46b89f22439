"""PNG and WebP files, and text, by Pillow, which also brings the font."""

import io
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import MissingDependencyError
from cascadenorm.render.color import Image

CAPITALS = 0.7
"""Height of capital letters, of the size of the font."""


def require_pillow() -> Any:
    """Return the package, with the modules that are needed here.

    Raises
    ------
    MissingDependencyError
        Pillow is not installed.
    """
    try:
        import PIL.Image
        import PIL.ImageDraw
        import PIL.ImageFont
    except ImportError:
        raise MissingDependencyError("drawing a picture", package="Pillow", extra="viz") from None
    return PIL


def webp(image: Image) -> bytes:
    """Return a picture as a WebP file, small and with losses that are hardly seen.

    Raises
    ------
    MissingDependencyError
        Pillow is not installed.
    """
    file = io.BytesIO()
    require_pillow().Image.fromarray(image).save(file, "WEBP", quality=85)
    return file.getvalue()


def animated_webp(images: Iterable[Image], *, milliseconds: int) -> bytes:
    """Return pictures as a WebP file that shows one after the other, again and again.

    Raises
    ------
    MissingDependencyError
        Pillow is not installed.
    """
    pillow = require_pillow()
    first, *others = [pillow.Image.fromarray(image) for image in images]
    file = io.BytesIO()
    first.save(file, "WEBP", save_all=True, append_images=others, duration=milliseconds, loop=0, quality=80)
    return file.getvalue()


def png(image: Image, *, dpi: int | None = None) -> bytes:
    """Return a picture as a PNG file of 8 bits a channel.

    Parameters
    ----------
    dpi
        Pixels an inch that the file states.

    Raises
    ------
    MissingDependencyError
        Pillow is not installed.
    """
    file = io.BytesIO()
    settings = {} if dpi is None else {"dpi": (dpi, dpi)}
    require_pillow().Image.fromarray(image).save(file, "PNG", **settings)
    return file.getvalue()


def printable(text: str) -> str:
    """Return text of one line: what cannot be printed is replaced."""
    return "".join(character if character.isprintable() else "\ufffd" for character in text)


def text_coverage(text: str, *, size: float, room: int) -> NDArray[np.float64]:
    """Draw a line of text.

    Parameters
    ----------
    text
        ASCII and °; the font has boxes for other characters.
    size
        Height of a capital letter, in pixels.
    room
        Pixels that there are for it; the line is cut there.

    Returns
    -------
    (height, width) how far each pixel is covered, from 0 to 1; the middle row is the middle of the capital letters
    """
    pillow = require_pillow()
    font = pillow.ImageFont.load_default(size / CAPITALS)
    line = printable(text)
    width = max(1, min(room, int(np.ceil(font.getlength(line))) + 1))
    height = 2 * round(1.5 * size)
    picture = pillow.Image.new("L", (width, height))
    pillow.ImageDraw.Draw(picture).text((0, height // 2 + round(size) // 2), line, fill=255, font=font, anchor="ls")
    return np.asarray(picture) / 255


def font_file() -> bytes:
    """Return the font as a TrueType file."""
    return bytes(require_pillow().ImageFont.load_default(10).path.getvalue())


def text_length(text: str, *, size: float) -> float:
    """Return the length of a line of text whose capital letters are `size` high."""
    return float(require_pillow().ImageFont.load_default(100).getlength(printable(text)) * size / CAPITALS / 100)
