"""Render a mesh with two lights, or with values as colours."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.mesh import Mesh, any_in_rows, unit
from cascadenorm.render.camera import Camera, projected
from cascadenorm.render.color import COLOR_STEPS, PAPER, HeatMap, Image, color_map, encoded, linear, named_colors
from cascadenorm.render.raster import Painted, rasterize

NEAREST = 0.99  # fraction of the distance to the viewer up to which faces are drawn; nearer faces are clipped
LINE_WIDTH = 0.7  # width of wireframe lines in pixels
_LIGHTS = (  # direction in the camera frame (right, up, toward the viewer), intensity
    ((0.0, 0.0, 1.0), 0.34),
    ((-0.45, 0.72, 0.53), 0.62),
)
_AMBIENT = 0.05


def render(
    mesh: Mesh,
    *,
    view: Camera | ArrayLike | None = None,
    size: tuple[int, int] = (800, 800),
    colors: NDArray[np.float64] | None = None,
    values: HeatMap | None = None,
    smooth: bool = False,
    wireframe: bool = False,
    transparent: bool = False,
    samples: int = 3,
) -> Image:
    """Render a mesh.

    Parameters
    ----------
    mesh
        Mesh to render. Both sides of faces are visible; the inside has another colour.
    view
        A camera, or the direction from the mesh toward the viewer with y up. None chooses a view.
    size
        Width and height in pixels.
    colors
        (m, 3) sRGB colours of the faces, 0 to 1, instead of clay.
    values
        Values that are shown as colours on both sides instead of clay.
    smooth
        Shade with vertex normals instead of face normals.
    wireframe
        Draw the edges.
    transparent
        Omit the white background.
    samples
        Each pixel is the mean of samples × samples points.

    Returns
    -------
    (height, width, 3) uint8, or (height, width, 4) with an alpha channel if transparent; the result does not depend on
    the number of threads
    """
    width, height = size
    if width < 1 or height < 1 or samples < 1:
        raise ValueError(f"size is {size} and samples {samples}; they must be at least 1")
    if not isinstance(view, Camera):
        view = Camera.looking_at(mesh, direction=view)
    used = mesh.topology.used_vertices[:, None]
    points = view.framed(np.where(used, mesh.vertices, view.center))
    near = points[:, 2] * view.perspective >= NEAREST
    points = projected(points, view.perspective)
    across, _ = view.half_size(size)
    pixels = width / across / 2
    points[:, :2] = (points[:, :2] - view.offset) * (pixels, -pixels) + (width / 2, height / 2)
    palette, places, light = _shaded(mesh, view, colors, values, smooth)
    line = LINE_WIDTH if wireframe else 0.0
    painted = Painted(points, mesh.faces, palette, places, light, view.perspective, line)
    if near.any():
        painted = painted.without(any_in_rows(near[mesh.faces]))
    picture = rasterize(painted, width=width, height=height, samples=samples)
    color, coverage = picture[..., :3], picture[..., 3:]
    if not transparent:
        return encoded(color + (1 - coverage) * linear(PAPER))
    own = np.divide(color, coverage, out=np.ones_like(color), where=coverage > 0)
    return np.concatenate([encoded(own), np.rint(255 * coverage).astype(np.uint8)], axis=2)


def _shaded(
    mesh: Mesh, view: Camera, colors: NDArray[np.float64] | None, values: HeatMap | None, smooth: bool
) -> tuple[NDArray[np.float64], ...]:
    """Return the palette, and the palette row and light of each triangle, (m, 1), or of its corners, (m, 3)."""
    toward_viewer = view.axes[2] - view.perspective * (mesh.centroids - view.center)
    outside = np.einsum("ij,ij->i", mesh.face_normals, toward_viewer) >= 0
    normals = mesh.vertex_normals[mesh.faces] if smooth else mesh.face_normals[:, None]
    light = np.full(normals.shape[:2], _AMBIENT)
    for direction, strength in _LIGHTS:
        facing = normals.reshape(-1, 3) @ (unit(np.array(direction)) @ view.axes)  # one product for all faces
        facing = np.where(outside[:, None], 1, -1) * facing.reshape(light.shape)
        light += strength * np.maximum(facing, 0)
    if colors is not None or values is not None:
        light = 0.5 + 0.5 * light  # reduce the relief in favour of the colours
    inside = linear(named_colors("inside"))
    if values is not None:
        palette, places = _heat(mesh, values)
    elif colors is not None:
        palette = np.concatenate([linear(colors), inside])
        places = np.where(outside, np.arange(len(colors), dtype=np.float64), len(colors))[:, None]
    else:
        palette, places = np.concatenate([linear(named_colors("clay")), inside]), np.where(outside, 0.0, 1.0)[:, None]
    return palette, places, light


def _heat(mesh: Mesh, values: HeatMap) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the palette of the values, which ends with the colour for unknown values, and the row of each corner."""
    low, high = values.limits
    with np.errstate(invalid="ignore"):
        places = np.clip((values.values - low) / (high - low or 1.0), 0, 1) * (COLOR_STEPS - 1)
    places = places[:, None] if values.at == "face" else places[mesh.faces]
    unknown = np.isnan(places).any(axis=1, keepdims=True)
    palette = np.concatenate([linear(color_map(signed=values.signed)), linear(named_colors("unknown"))])
    return palette, np.where(unknown, COLOR_STEPS, places)
