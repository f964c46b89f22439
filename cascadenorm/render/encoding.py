"""Encode images as PNG and WebP with Pillow."""

import io
from collections.abc import Iterable

import PIL.Image

from cascadenorm.render.color import Image


def png(image: Image, *, dpi: int | None = None) -> bytes:
    """Encode an image as PNG with 8 bits per channel, and optionally its resolution in pixels per inch."""
    file = io.BytesIO()
    settings = {} if dpi is None else {"dpi": (dpi, dpi)}
    PIL.Image.fromarray(image).save(file, "PNG", **settings)
    return file.getvalue()


def webp(image: Image) -> bytes:
    """Encode an image as WebP with hardly visible losses."""
    file = io.BytesIO()
    PIL.Image.fromarray(image).save(file, "WEBP", quality=85)
    return file.getvalue()


def animated_webp(images: Iterable[Image], *, milliseconds: int) -> bytes:
    """Encode images as a WebP animation that repeats indefinitely."""
    first, *others = map(PIL.Image.fromarray, images)
    file = io.BytesIO()
    first.save(file, "WEBP", save_all=True, append_images=others, duration=milliseconds, loop=0, quality=80)
    return file.getvalue()
