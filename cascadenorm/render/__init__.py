"""Pictures of meshes without a GPU or a window: camera, shading, captions, PNG files."""

from cascadenorm.render.camera import Camera
from cascadenorm.render.color import Image, error_colors
from cascadenorm.render.drawing import render
from cascadenorm.render.montage import error_legend, side_by_side
from cascadenorm.render.pillow import png, webp

__all__ = ["Camera", "Image", "error_colors", "error_legend", "png", "render", "side_by_side", "webp"]
