"""Figures as SVG: pictures as pixels, text and frames as what they are."""

from base64 import b64encode
from html import escape

import numpy as np

from cascadenorm.render.color import INK
from cascadenorm.render.figure import DPI, Figure, Frame, Picture, Text
from cascadenorm.render.pillow import CAPITALS, png, printable

FONTS = "Aileron, Helvetica, Arial, sans-serif"


def svg(figure: Figure, *, transparent: bool = False) -> bytes:
    """Return a figure as an SVG file of DPI pixels an inch, on white paper or on none.

    Raises
    ------
    MissingDependencyError
        Pillow is not installed.
    """
    width, height = (f"{72 * length / DPI:g}pt" for length in (figure.width, figure.height))
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" '
        f'viewBox="0 0 {figure.width} {figure.height}">'
    ]
    if not transparent:
        lines.append('<rect width="100%" height="100%" fill="#ffffff"/>')
    lines += [_element(item) for item in figure.items]
    return "\n".join([*lines, "</svg>", ""]).encode()


def _element(item: Picture | Text | Frame) -> str:
    if isinstance(item, Picture):
        height, width, _ = item.image.shape
        data = b64encode(png(item.image)).decode("ascii")
        place = f'x="{item.left}" y="{item.top}" width="{width}" height="{height}"'
        return f'<image {place} href="data:image/png;base64,{data}"/>'
    if isinstance(item, Frame):
        place = f'x="{item.left:g}" y="{item.top:g}" width="{item.width:g}" height="{item.height:g}"'
        return f'<rect {place} fill="none" stroke="{_hex(item.color)}" stroke-width="{item.line:g}"/>'
    anchor = "start" if item.begins else "middle"
    turn = " rotate(-90)" if item.upward else ""
    return (
        f'<text transform="translate({item.x:g} {item.y:g}){turn}" dy="{item.size / 2:g}" text-anchor="{anchor}" '
        f'font-family="{FONTS}" font-size="{item.size / CAPITALS:g}" fill="{_hex(INK)}">'
        f"{escape(printable(item.text))}</text>"
    )


def _hex(color: tuple[float, float, float]) -> str:
    return "#" + "".join(f"{part:02x}" for part in np.rint(255 * np.array(color)).astype(int).tolist())
