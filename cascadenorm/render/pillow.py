"""PNG files and text by Pillow, which also brings the font."""

import io
from typing import Any

import numpy as np

from cascadenorm.errors import MissingDependencyError
from cascadenorm.render.color import INK, Image, encoded, linear

_CAPITALS = 0.7  # height of capital letters, of the size of the font


def require_pillow() -> Any:
    """Return the package, with the modules that are needed here.

    Raises
    ------
    MissingDependencyError : Pillow is not installed
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
    MissingDependencyError : Pillow is not installed
    """
    file = io.BytesIO()
    require_pillow().Image.fromarray(image).save(file, "WEBP", quality=85)
    return file.getvalue()


def png(image: Image) -> bytes:
    """Return a picture as a PNG file of 8 bits a channel.

    Raises
    ------
    MissingDependencyError : Pillow is not installed
    """
    file = io.BytesIO()
    require_pillow().Image.fromarray(image).save(file, "PNG")
    return file.getvalue()


def add_text(image: Image, text: str, *, left: int | None, middle: int, size: int) -> Image:
    """Return a picture with a line of text, cut where the picture ends.

    Parameters
    ----------
    image : (height, width, 3) picture
    text : ASCII and °; the font has boxes for other characters
    left : where the text begins, in pixels; None centers it
    middle : row in the middle of its capital letters
    size : height of a capital letter, in pixels
    """
    pillow = require_pillow()
    picture = pillow.Image.fromarray(image)
    font = pillow.ImageFont.load_default(size / _CAPITALS)
    line = "".join(character if character.isprintable() else "\ufffd" for character in text)
    start = max(0, round((image.shape[1] - font.getlength(line)) / 2)) if left is None else left
    ink = tuple(encoded(linear(INK)).tolist())
    pillow.ImageDraw.Draw(picture).text((start, middle + size // 2), line, fill=ink, font=font, anchor="ls")
    return np.array(picture)
