"""A mesh in one picture: flat shading by two lights, so that noise and edges are seen."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.mesh import Mesh, unit
from cascadenorm.render.camera import Camera, projected
from cascadenorm.render.color import PAPER, Image, encoded, linear
from cascadenorm.render.raster import rasterize

CLAY = (0.72, 0.76, 0.82)
INSIDE = (0.80, 0.55, 0.42)
_MARGIN = 1.06
_LIGHTS = (  # direction in the camera's frame (right, up, toward the viewer), strength
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
    samples: int = 3,
) -> Image:
    """Draw a mesh with one shade a face.

    Parameters
    ----------
    mesh : what is drawn; its faces are seen from both sides, from the inside in another colour
    view : a camera, or the direction from the mesh toward the viewer, y upward; None chooses one
    size : width and height in pixels
    colors : (m, 3) sRGB from 0 to 1, one a face, instead of clay
    samples : each pixel is the mean of samples × samples points

    Returns
    -------
    (height, width, 3) uint8, the same bytes for any number of threads
    """
    width, height = size
    if width < 1 or height < 1 or samples < 1:
        raise ValueError(f"size is {size} and samples {samples}; they must be at least 1")
    if not isinstance(view, Camera):
        view = Camera.looking_at(mesh, direction=view)
    screen = projected(view.framed(mesh.corners), view.perspective)
    pixels = min(width / max(view.reach[0], 1e-300), height / max(view.reach[1], 1e-300)) / (2 * _MARGIN)
    screen[..., :2] *= (pixels, -pixels)
    screen[..., :2] += (width / 2, height / 2)
    painted = rasterize(screen, _shaded(mesh, view, colors), width=width, height=height, samples=samples)
    return encoded(painted[..., :3] + (1 - painted[..., 3:]) * linear(PAPER))


def _shaded(mesh: Mesh, view: Camera, colors: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """(m, 3) linear colour of each face: a light at the viewer, a second one from the upper left."""
    normals = mesh.normals @ view.axes.T
    outside = normals[:, 2] - view.perspective * np.einsum("ij,ij->i", view.framed(mesh.centroids), normals) >= 0
    normals = np.where(outside[:, None], normals, -normals)
    light = np.full(len(normals), _AMBIENT)
    for direction, strength in _LIGHTS:
        light += strength * np.maximum(normals @ unit(np.array(direction)), 0)
    if colors is not None:
        light = 0.5 + 0.5 * light  # what a colour stands for matters more than relief
    surface = linear(CLAY if colors is None else colors)
    return np.asarray(np.where(outside[:, None], surface, linear(INSIDE)) * light[:, None])
