"""What depth cameras see of a field: a distance for each ray of a grid, and the open sheet of triangles over it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.data_gen.meshing.surface import HALF_SIDE, Extent, UnfitShapeError, largest_components
from cascadenorm.data_gen.meshing.untangle import untangled
from cascadenorm.data_gen.shapes.fields import DistanceField, Values
from cascadenorm.data_gen.shapes.placement import random_rotation
from cascadenorm.mesh import Mesh, Vectors, unit

VIEW_STEPS = 70
SEEN = 4.5  # a closed surface has about so many times the area that a view of it covers
STEEP = 3.5  # triangles with a side longer than this many steps of the grid span a gap in depth and are left out
FEWEST_SHEET_FACES = 100  # faces of a sheet that shows something
DISTANCES = 4.0, 6.0, 30.0  # of cameras; rays from the last are nearly parallel


class DepthImage(NamedTuple):
    """Where the rays of a camera first meet a surface.

    The rays pass through a grid with `pixels` along both sides in the plane at `distance` from the eye.
    """

    eye: Vectors  # (3,)
    turn: Vectors  # (3, 3), its columns: along the grid's sides, and from what is seen toward the eye
    distance: float
    pixels: Values  # (p,)
    ratio: float  # of the step along the second side of the grid to that along the first
    depth: Values  # (p * p,) along the ray; infinite where it meets nothing
    points: Vectors  # (p * p, 3) where the rays end; at the eye if they meet nothing

    @property
    def gap(self) -> float:
        """Length of a side that spans a gap in depth."""
        return float(STEEP * (self.pixels[1] - self.pixels[0]) * self.ratio)

    @property
    def faces(self) -> NDArray[np.int32]:
        """Two triangles for each four pixels, (m, 3), but none across gaps in depth."""
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
    """Look at a field from a direction, with rays so far apart where they pass the middle."""
    eye = middle + distance * turn[:, 2]
    count = int(2 * HALF_SIDE / step)
    pixels = step * (np.arange(count, dtype=np.float64) - 0.5 * (count - 1))
    grid = np.stack(np.meshgrid(pixels, ratio * pixels, indexing="ij"), axis=-1).reshape(-1, 2)
    rays = unit(middle + grid @ turn[:, :2].T - eye)
    depth = traced(field, eye, rays, start=distance - HALF_SIDE, stop=distance + HALF_SIDE)
    points = eye + np.where(np.isfinite(depth), depth, 0)[:, None] * rays
    return DepthImage(eye, turn, distance, pixels, ratio, depth, points)


def view(field: DistanceField, extent: Extent, *, faces: int, rng: np.random.Generator, ratio: float = 1.0) -> Mesh:
    """Mesh what is visible of a field from a random direction, a vertex a ray; `ratio` is that of the grid's steps."""
    step = float(np.sqrt(extent.area / SEEN / (0.5 * faces) / ratio))
    turn = random_rotation(rng=rng)
    distance = float(rng.choice(DISTANCES))
    image = depth_image(field, extent.middle, turn, distance=distance, step=step, ratio=ratio)
    return largest_sheets(image.points, image.faces)


def traced(field: DistanceField, eye: Vectors, directions: Vectors, *, start: float, stop: float) -> Values:
    """Distance along each ray to where the field first vanishes; infinite where it does not."""
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
    """Make a manifold of the larger parts of what is seen."""
    if len(faces) < FEWEST_SHEET_FACES:
        raise UnfitShapeError("the view shows next to nothing")
    return largest_components(untangled(largest_components(Mesh(vertices, faces), share=0.05)), share=0.05)
