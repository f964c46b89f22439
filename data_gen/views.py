"""Open sheets as a depth camera sees them from one side: a vertex a ray, or marching cubes as of a fused volume."""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.data_gen.fields import Field, Values
from cascadenorm.data_gen.lattice import sample
from cascadenorm.data_gen.placement import random_rotation
from cascadenorm.data_gen.polygonise import NoSurfaceError, marching_cubes
from cascadenorm.data_gen.surface import REACH, Extent, UnfitShapeError, largest_components
from cascadenorm.data_gen.untangle import untangled
from cascadenorm.mesh import Mesh, Vectors, unit

STEPS = 70
FUSED = 0.5  # share of the views that are to come from a volume; some more of these are unfit
LIT = 0.4  # share of a closed surface that is seen from one side, about
FLATTEST = 0.15  # cosine against the ray of faces that a camera still measures
SEEN = 4.5  # a closed surface has about so many times the area that a view of it covers
STEEP = 3.5  # triangles with a side longer than this many steps of the grid span a gap in depth and are left out


def view(field: Field, extent: Extent, *, faces: int, rng: np.random.Generator) -> Mesh:
    """Mesh what is visible of a field from a random direction, by parallel or diverging rays.

    Either on their regular grid, or by marching cubes on a lattice, as a volume is meshed into which depths were fused
    (Curless, Levoy 1996): with stairs and slivers.
    """
    turn = random_rotation(rng=rng)
    middle = 0.5 * (extent.lower + extent.upper)
    distance = float(rng.choice([4.0, 6.0, 30.0]))
    eye = middle + distance * turn[:, 2]
    if rng.random() < FUSED:
        return _of_volume(field, extent, eye, distance, faces=faces, rng=rng)
    step = float(np.sqrt(extent.area / SEEN / (0.5 * faces)))
    count = int(2 * REACH / step)
    across = step * (np.arange(count) - 0.5 * (count - 1))
    grid = np.stack(np.meshgrid(across, across, indexing="ij"), axis=-1).reshape(-1, 2)
    targets = middle + grid @ turn[:, :2].T
    directions = targets - eye
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    depth = traced(field, eye, directions, start=distance - REACH, stop=distance + REACH)
    points = eye + np.where(np.isfinite(depth), depth, 0)[:, None] * directions
    return _sheet(points, np.isfinite(depth).reshape(count, count), longest=STEEP * step)


def _of_volume(
    field: Field, extent: Extent, eye: Vectors, distance: float, *, faces: int, rng: np.random.Generator
) -> Mesh:
    """Polygonise the whole, and keep the faces that the camera sees."""
    spacing = float(np.sqrt(2.3 * LIT * extent.area / faces))
    turn = random_rotation(rng=rng)
    lattice = sample(field, lower=extent.lower, upper=extent.upper, spacing=spacing, turn=turn, rng=rng)
    try:
        mesh = marching_cubes(field, lattice)
    except NoSurfaceError as error:
        raise UnfitShapeError(str(error)) from error
    rays = mesh.vertices - eye
    lengths = np.linalg.norm(rays, axis=1)
    depth = traced(field, eye, rays / lengths[:, None], start=distance - REACH, stop=distance + REACH)
    seen = lengths < depth + 0.5 * spacing
    facing = -np.einsum("ij,ij->i", mesh.normals, unit(mesh.centroids - eye)) > FLATTEST
    return _kept(mesh.vertices, mesh.faces[seen[mesh.faces].all(axis=1) & facing])


def traced(field: Field, eye: Vectors, directions: Vectors, *, start: float, stop: float) -> Values:
    """Distance along each ray to where the field first vanishes; infinite where it does not."""
    depth = np.full(len(directions), np.inf)
    going = np.arange(len(directions))
    reached = np.full(len(directions), start)
    for _ in range(STEPS):
        values = field(eye + reached[:, None] * directions[going])
        there = np.abs(values) < 1e-5
        depth[going[there]] = reached[there]
        reached = reached + 0.8 * values
        keep = ~there & (reached < stop)
        going, reached = going[keep], reached[keep]
        if len(going) == 0:
            break
    return depth


def _sheet(points: Vectors, hit: NDArray[np.bool_], *, longest: float) -> Mesh:
    index = np.arange(hit.size).reshape(hit.shape)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    shorter = np.linalg.norm(points[a] - points[c], axis=-1) < np.linalg.norm(points[b] - points[d], axis=-1)
    first = np.where(shorter[..., None], np.stack([a, b, c], -1), np.stack([a, b, d], -1))
    second = np.where(shorter[..., None], np.stack([a, c, d], -1), np.stack([b, c, d], -1))
    faces = np.concatenate([first.reshape(-1, 3), second.reshape(-1, 3)]).astype(np.int32)
    corners = points[faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    faces = faces[hit.ravel()[faces].all(axis=1) & (sides.max(axis=1) < longest)]
    return _kept(points, faces)


def _kept(points: Vectors, faces: NDArray[np.int32]) -> Mesh:
    """Make a manifold of the larger parts of what is seen."""
    if len(faces) < 100:
        raise UnfitShapeError("the view shows next to nothing")
    return largest_components(untangled(largest_components(Mesh(points, faces), share=0.05)), share=0.05)
