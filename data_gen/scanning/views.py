"""Depth images of a field, the open sheets of triangles over them, and the surfaces that several images fuse into.

Fused meshes have stairs and slivers, and the error also determines the triangles.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator
from scipy.spatial.transform import Rotation

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.lattice import grid
from cascadenorm.data_gen.meshing.polygonise import gradients, off_nodes, onto_surface
from cascadenorm.data_gen.meshing.surface import HALF_SIDE, Extent, disentangled
from cascadenorm.data_gen.noise.sensor import camera_errors
from cascadenorm.data_gen.scanning.measured import Measured
from cascadenorm.data_gen.shapes.fields import DistanceField, Values
from cascadenorm.data_gen.shapes.placement import random_rotation
from cascadenorm.mesh import Mesh, Vectors, angles_between, unit

VIEW_STEPS = 70
SEEN = 4.5  # approximate ratio of the area of a closed surface to that seen in a view
STEEP = 3.5  # triangles with a side longer than this many grid steps span a gap in depth and are left out
FEWEST_SHEET_FACES = 100  # fewest faces of a usable sheet
DISTANCES = 4.0, 6.0, 30.0  # distances of cameras; rays from the last are nearly parallel
LIT = 0.45, 0.85  # approximate share of a closed surface seen by cameras on one side of it, and all around
IMAGES = 8  # largest number of images from one side; all around, the least number, and at most twice as many
TURNED = np.pi / 3  # largest angle between the cameras on one side and the middle one
MOST_TILT = np.radians(5)  # largest mean angle between the clean mesh and the surface under it


class DepthImage(NamedTuple):
    """Where the rays of a camera first meet a surface.

    The rays pass through a grid with `pixels` along both sides in the plane at `distance` from the eye.
    """

    eye: Vectors  # (3,)
    turn: Vectors  # (3, 3) columns: along the grid's sides, and from the scene toward the eye
    distance: float
    pixels: Values  # (p,)
    gap: float  # length above which a side spans a gap in depth
    depth: Values  # (p * p,) along the ray; infinite if it meets nothing
    points: Vectors  # (p * p, 3) end points of the rays; the eye if they meet nothing

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
    """Trace a field from a direction; `step` is the distance between rays at the middle of the scene.

    `ratio` is that of the step along the second side of the grid to that along the first.
    """
    eye = middle + distance * turn[:, 2]
    count = int(2 * HALF_SIDE / step)
    pixels = step * (np.arange(count, dtype=np.float64) - 0.5 * (count - 1))
    grid = np.stack(np.meshgrid(pixels, ratio * pixels, indexing="ij"), axis=-1).reshape(-1, 2)
    rays = unit(middle + grid @ turn[:, :2].T - eye)
    depth = traced(field, eye, rays, start=distance - HALF_SIDE, stop=distance + HALF_SIDE)
    points = eye + np.where(np.isfinite(depth), depth, 0)[:, None] * rays
    gap = float(STEEP * (pixels[1] - pixels[0]) * ratio)
    return DepthImage(eye, turn, distance, pixels, gap, depth, points)


def scanned_view(
    field: DistanceField, extent: Extent, *, faces: int, rng: np.random.Generator, ratio: float = 1.0
) -> Mesh:
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
    return disentangled(Mesh(vertices, faces))


def fused(field: DistanceField, extent: Extent, *, faces: int, level: float, rng: np.random.Generator) -> Measured:
    """Fuse depth images of a field (Curless, Levoy 1996; Newcombe et al. 2011) into a mesh of about `faces` faces.

    The cameras are on one side or all around. Unlike noise on the vertices of a mesh, the error determines where
    triangles are: vertices stay on the edges of the lattice, and those of a sliver have similar errors. The level is
    the deviation of the error between neighbouring pixels, in spacings of the lattice. For cameras all around it is
    halved, since the surface folds where many images meet. Raises UnfitShapeError if little is seen, or if the detail
    of the shape is lost in the error or between the nodes.
    """
    around = bool(rng.random() < 0.5)
    spacing = float(np.sqrt(2.3 * LIT[around] * extent.area / faces))
    step = spacing * rng.uniform(0.6, 1.6)
    deviation = level * spacing * (0.5 if around else 1.0)
    truncation = spacing * rng.uniform(2.5, 5) + 2 * deviation
    distance = float(rng.choice(DISTANCES))
    facing = random_rotation(rng=rng)
    spread = np.pi if around else rng.uniform(0, TURNED)
    smooth = bool(rng.random() < 0.5)
    images = []
    for _ in range(round(IMAGES * 2 ** rng.random() if around else IMAGES ** rng.random())):
        turn = facing @ _tilt(spread, rng=rng)
        image = depth_image(field, extent.middle, turn, distance=distance, step=step)
        images.append((image, _measured(image, deviation, rng=rng)))

    turn = facing if rng.random() < 0.5 else random_rotation(rng=rng)
    half = np.abs(turn.T) @ (0.5 * (extent.upper - extent.lower)) + 2 * spacing
    nodes = grid(half, np.full(3, spacing)) @ turn.T + extent.middle
    noisy = _meshed(_distances(images, nodes, truncation=truncation, smooth=smooth), nodes, spacing)
    clean = noisy.moved(onto_surface(field, noisy.vertices, size=spacing, reach=np.inf, steps=6))
    true = unit(gradients(field, clean.centroids, step=1e-3 * spacing))
    if angles_between(clean.face_normals, true).mean() > MOST_TILT:
        raise UnfitShapeError("the clean mesh is not that of the shape")
    return Measured(noisy, clean, clean.face_normals)


def _tilt(spread: float, *, rng: np.random.Generator) -> Vectors:
    """Draw a roll about z followed by a tilt of z by up to an angle, uniform over that part of the sphere."""
    tilt = np.arccos(1 - rng.random() * (1 - np.cos(spread)))
    around, roll = rng.uniform(0, 2 * np.pi, 2)
    axis = tilt * np.array([np.cos(around), np.sin(around), 0.0])
    return np.asarray(Rotation.from_rotvec(axis).as_matrix() @ Rotation.from_rotvec([0, 0, roll]).as_matrix())


def _measured(image: DepthImage, deviation: float, *, rng: np.random.Generator) -> Values:
    """Return depths with the error of a camera, (p * p,), or NaN."""
    faces = image.faces
    if len(faces) < FEWEST_SHEET_FACES:
        raise UnfitShapeError("a camera sees next to nothing")
    pixels, corners = np.unique(faces, return_inverse=True)
    measured = np.full(image.depth.shape, np.nan)
    sheet = Mesh(image.points[pixels], corners.reshape(-1, 3))
    measured[pixels] = image.depth[pixels] - camera_errors(image.depth[pixels], sheet, deviation, rng=rng)
    return measured


def _distances(
    images: list[tuple[DepthImage, Values]], nodes: NDArray[np.float64], *, truncation: float, smooth: bool
) -> NDArray[np.float64]:
    """Average the signed distances of the nodes over the images, (p, q, r); NaN far behind the surface.

    Depths between pixels are interpolated if `smooth`, and otherwise taken from the nearest pixel.
    """
    points = nodes.reshape(-1, 3)
    total, count = np.zeros(len(points)), np.zeros(len(points), np.int64)
    for image, measured in images:
        rays = points - image.eye
        at = rays @ image.turn[:, :2] * (image.distance / -(rays @ image.turn[:, 2]))[:, None]
        sides, values = (image.pixels, image.pixels), measured.reshape(len(image.pixels), -1)
        depths = RegularGridInterpolator(sides, values, bounds_error=False, fill_value=np.nan)
        depth = depths(at, method="nearest")
        if smooth:
            between = depths(at)
            depth = np.where(np.abs(between - depth) > 0.5 * image.gap, np.nan, between)
        before = depth - np.linalg.norm(rays, axis=1)
        near = before > -truncation
        total[near] += np.minimum(before[near], truncation)
        count[near] += 1
    distances = np.divide(total, count, out=np.full(len(points), np.nan), where=count > 0)
    return np.asarray(distances.reshape(nodes.shape[:3]))


def _meshed(distances: NDArray[np.float64], nodes: NDArray[np.float64], spacing: float) -> Mesh:
    """Run marching cubes, linear along edges, on the cells whose nodes all have a distance."""
    from skimage.measure import marching_cubes

    seen = ~np.isnan(distances)
    values = off_nodes(np.where(seen, distances, spacing), spacing)
    if values.min() > 0:
        raise UnfitShapeError("no node is behind the surface")
    found, faces, _, _ = marching_cubes(values, 0.0)  # type: ignore[no-untyped-call]
    cells = np.floor(found[faces].mean(axis=1)).astype(np.int64)
    whole = np.all([seen[tuple((cells + corner).T)] for corner in np.ndindex(2, 2, 2)], axis=0)
    origin, axes = nodes[0, 0, 0], np.stack([nodes[1, 0, 0], nodes[0, 1, 0], nodes[0, 0, 1]]) - nodes[0, 0, 0]
    return largest_sheets(origin + found.astype(np.float64) @ axes, faces[whole])
