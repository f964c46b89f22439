"""Depth images of a field, and the open sheets of triangles over them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.data_gen.meshing.surface import HALF_SIDE, Extent, UnfitShapeError, disentangled
from cascadenorm.data_gen.shapes.fields import DistanceField, Values
from cascadenorm.data_gen.shapes.placement import random_rotation
from cascadenorm.mesh import Mesh, Vectors, unit

VIEW_STEPS = 70
SEEN = 4.5  # approximate ratio of the area of a closed surface to that seen in a view
STEEP = 3.5  # triangles with a side longer than this many grid steps span a gap in depth and are left out
FEWEST_SHEET_FACES = 100  # fewest faces of a usable sheet
DISTANCES = 4.0, 6.0, 30.0  # distances of cameras; rays from the last are nearly parallel


class DepthImage(NamedTuple):
    """Where the rays of a camera first meet a surface.

    The rays pass through a grid with `pixels` along both sides in the plane at `distance` from the eye.
    """

    eye: Vectors  # (3,)
    turn: Vectors  # (3, 3) columns: along the grid's sides, and from the scene toward the eye
    distance: float
    pixels: Values  # (p,)
    ratio: float  # ratio of the step along the second side of the grid to that along the first
    depth: Values  # (p * p,) along the ray; infinite if it meets nothing
    points: Vectors  # (p * p, 3) end points of the rays; the eye if they meet nothing

    @property
    def gap(self) -> float:
        """Return the length above which a side spans a gap in depth."""
        return float(STEEP * (self.pixels[1] - self.pixels[0]) * self.ratio)

    @property
    def faces(self) -> NDArray[np.int32]:
        """Return two triangles for each four pixels, (m, 3), except across gaps in depth."""
        index = np.arange(len(self.depth)).reshape(len(self.pixels), -1)
        points = self.points
        a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
        shorter = np.linalg.norm(points[a] - points[c], axis=-1) < np.linalg.norm(points[b] - points[d], axis=-1)
        first = np.where(shorter[..., None], np.stack([a, b, c], -1), np.stack([a, b, d], -1))
        second = np.where(shorter[..., None], np.stack([a, c, d], -1), np.stack([b, c, d], -1))
        faces = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)]).astype(np.int32)
        corners = points[faces]
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        return np.asarray(faces[np.isfinite(self.depth)[faces].all(axis=1) & (longest < self.gap)])


def depth_image(
    field: DistanceField, middle: Vectors, turn: Vectors, *, distance: float, step: float, ratio: float = 1.0
) -> DepthImage:
    """Trace a field from a direction; `step` is the distance between rays at the middle of the scene."""
    eye = middle + distance * turn[:, 2]
    count = int(2 * HALF_SIDE / step)
    pixels = step * (np.arange(count, dtype=np.float64) - 0.5 * (count - 1))
    grid = np.stack(np.meshgrid(pixels, ratio * pixels, indexing="ij"), axis=-1).reshape(-1, 2)
    rays = unit(middle + grid @ turn[:, :2].T - eye)
    depth = traced(field, eye, rays, start=distance - HALF_SIDE, stop=distance + HALF_SIDE)
    points = eye + np.where(np.isfinite(depth), depth, 0)[:, None] * rays
    return DepthImage(eye, turn, distance, pixels, ratio, depth, points)


def view(field: DistanceField, extent: Extent, *, faces: int, rng: np.random.Generator, ratio: float = 1.0) -> Mesh:
    """Mesh what is visible of a field from a random direction, one vertex per ray, on a grid of steps with `ratio`."""
    step = float(np.sqrt(extent.area / SEEN / (0.5 * faces) / ratio))
    turn = random_rotation(rng=rng)
    distance = float(rng.choice(DISTANCES))
    image = depth_image(field, extent.middle, turn, distance=distance, step=step, ratio=ratio)
    return largest_sheets(image.points, image.faces)


def traced(field: DistanceField, eye: Vectors, directions: Vectors, *, start: float, stop: float) -> Values:
    """Return the distance along each ray to the first zero of the field; infinite where there is none."""
    depth = np.full(len(directions), np.inf)
    going = np.arange(len(directions))
    reached = np.full(len(directions), start)
    for _ in range(VIEW_STEPS):
        values = field(eye + reached[:, None] * directions[going])
        there = np.abs(values) < 1e-5
        depth[going[there]] = reached[there]
        reached = reached + 0.8 * values
        keep = ~there & (reached < stop)
        going, reached = going[keep], reached[keep]
        if len(going) == 0:
            break
    return depth


def largest_sheets(vertices: Vectors, faces: NDArray[np.int32]) -> Mesh:
    """Return the larger components of a sheet as a manifold."""
    if len(faces) < FEWEST_SHEET_FACES:
        raise UnfitShapeError("the view shows next to nothing")
    return disentangled(Mesh(vertices, faces), share=0.05)
