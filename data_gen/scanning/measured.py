"""Meshes of measured surfaces with their ground truth."""

from typing import NamedTuple

import numpy as np

from cascadenorm.data_gen.meshing.polygonise import gradients, onto_surface
from cascadenorm.data_gen.shapes.fields import DistanceField
from cascadenorm.mesh import Mesh, Vectors, unit

CONVERGED = 0.02  # largest distance from the surface, in cells, of a point that was projected onto it
FARTHEST_CELLS = 3.0  # largest distance, in cells, between a face and its part of the surface


class Measured(NamedTuple):
    """A measured mesh and its ground truth."""

    noisy: Mesh
    clean: Mesh  # with the same m faces, over the points of the shape beneath the vertices
    normals: Vectors  # (m, 3) true normal of each face of the noisy mesh; zero where it is unknown

    @classmethod
    def on_surface(cls, noisy: Mesh, clean: Mesh) -> "Measured":
        """Pair two meshes with the same faces. The normals of the clean mesh are the true ones."""
        return cls(noisy, clean, clean.face_normals)


def beneath(field: DistanceField, noisy: Mesh, *, cell: float) -> Measured:
    """Find the ground truth of a mesh whose triangles differ from those of the shape, such as one made of voxels.

    The true position of a vertex is the nearest point of the shape, found by following the gradient of its field, which
    is a signed distance near the surface. The true normal of a face is the direction of the gradient at the point
    nearest to its centroid. `cell` is the length of the details that the measurement resolves, such as the edge of a
    voxel.
    """
    points = onto_surface(field, np.concatenate([noisy.vertices, noisy.centroids]), size=cell, steps=8)
    vertices, feet = np.split(points, [len(noisy.vertices)])
    slope = gradients(field, feet, step=1e-3 * cell)
    found = np.abs(field(feet)) < CONVERGED * cell
    near = np.linalg.norm(feet - noisy.centroids, axis=1) < FARTHEST_CELLS * cell
    known = found & near & (np.einsum("ij,ij->i", slope, slope) > 0.1) & (noisy.areas > 0)
    return Measured(noisy, noisy.moved(vertices), np.where(known[:, None], unit(slope), 0.0))
