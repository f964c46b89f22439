"""Render meshes to pictures without a GPU or a window."""

from cascadenorm.render.camera import Camera
from cascadenorm.render.color import HeatMap, Image, color_map
from cascadenorm.render.drawing import render
from cascadenorm.render.encoding import png, webp
from cascadenorm.render.figure import Bar, Inset, Panel, inline_row, inline_svg, montage, pixels

__all__ = [
    "Bar", "Camera", "HeatMap", "Image", "Inset", "Panel", "color_map", "inline_row", "inline_svg", "montage", "pixels",
    "png", "render", "webp",
]  # fmt: skip
