"""Bodies meshed from volumes that were enlarged voxel by voxel."""

import numpy as np
from skimage.measure import marching_cubes

from cascadenorm.mesh import Mesh


def terraces(distance, voxels: int, factor: int, *, binary: bool = False) -> Mesh:
    """A body in a cube from -1 to 1, meshed from its distance looked up at one of `factor` voxels along each axis."""
    count = voxels * factor
    places = np.stack(np.meshgrid(*[(np.arange(voxels) + 0.5) * 2 / voxels - 1] * 3, indexing="ij"), axis=-1)
    values = -distance(places)
    values = np.where(values > 0, 1.0, -1.0) if binary else values
    for axis in range(3):
        values = np.repeat(values, factor, axis=axis)
    vertices, faces, *_ = marching_cubes(values, 0.0)
    return Mesh((vertices + 0.5) * 2 / count - 1, faces[:, ::-1])


def ball(places: np.ndarray) -> np.ndarray:
    return np.linalg.norm(places, axis=-1) - 0.8


MASK = terraces(ball, 16, 3, binary=True)
