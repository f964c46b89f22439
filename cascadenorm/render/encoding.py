"""Pixels as PNG and WebP files, by Pillow."""

import io
from collections.abc import Iterable

import PIL.Image

from cascadenorm.render.color import Image


def png(image: Image, *, dpi: int | None = None) -> bytes:
    """Return a picture as a PNG file of 8 bits a channel.

    Parameters
    ----------
    dpi
        Pixels an inch that the file states.
    """
    file = io.BytesIO()
    settings = {} if dpi is None else {"dpi": (dpi, dpi)}
    PIL.Image.fromarray(image).save(file, "PNG", **settings)
    return file.getvalue()


def webp(image: Image) -> bytes:
    """Return a picture as a WebP file, small and with losses that are hardly seen."""
    file = io.BytesIO()
    PIL.Image.fromarray(image).save(file, "WEBP", quality=85)
    return file.getvalue()


def animated_webp(images: Iterable[Image], *, milliseconds: int) -> bytes:
    """Return pictures as a WebP file that shows one after the other, again and again."""
    first, *others = map(PIL.Image.fromarray, images)
    file = io.BytesIO()
    first.save(file, "WEBP", save_all=True, append_images=others, duration=milliseconds, loop=0, quality=80)
    return file.getvalue()
