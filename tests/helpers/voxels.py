"""Signed distances on lattices of voxels, and the surfaces that are extracted from them."""

import numpy as np
from skimage.measure import marching_cubes

from cascadenorm.mesh import Mesh


def volume(shape: str, voxel, count: int = 40):
    """Signed distances to a ball or an ellipsoid at the nodes of a lattice, positive inside."""
    nodes = np.stack(np.meshgrid(*[np.arange(count) - count / 2 + 0.3] * 3, indexing="ij"), axis=-1) * voxel
    axes = {"ball": (9.0, 9.0, 9.0), "egg": (9.0, 7.0, 11.0)}[shape]
    return 8 * (1 - np.linalg.norm(nodes / np.array(axes), axis=-1))


def extracted(values, voxel) -> Mesh:
    vertices, faces, _, _ = marching_cubes(-values, 0.0)
    return Mesh(vertices.astype(np.float64) * voxel, faces)
