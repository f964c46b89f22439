"""Pictures of meshes without a GPU or a window: camera, shading, heat maps, captions, files."""

from cascadenorm.render.camera import Camera
from cascadenorm.render.color import HeatMap, Image, color_map
from cascadenorm.render.drawing import render
from cascadenorm.render.figure import Figure, rasterized, stacked
from cascadenorm.render.panels import color_bar, side_by_side
from cascadenorm.render.pillow import png, webp

__all__ = [
    "Camera",
    "Figure",
    "HeatMap",
    "Image",
    "color_bar",
    "color_map",
    "png",
    "rasterized",
    "render",
    "side_by_side",
    "stacked",
    "webp",
]
