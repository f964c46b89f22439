"""Meshes with holes."""

import numpy as np
from shapes import icosphere

from cascadenorm.mesh import Mesh


def without(mesh, faces):
    """Return the mesh without the given faces, and without the vertices that only they used."""
    kept = mesh.faces[~faces]
    used = np.unique(kept)
    number = np.zeros(len(mesh.vertices), int)
    number[used] = np.arange(len(used))
    return Mesh(mesh.vertices[used], number[kept])


def without_cap(level, height):
    sphere = icosphere(level)
    return without(sphere, (sphere.vertices[sphere.faces][..., 2] > height).any(axis=1))
