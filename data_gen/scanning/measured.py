"""Meshes of measured surfaces, with the points of the shape beneath their vertices and their true normals."""

from typing import NamedTuple

import numpy as np

from cascadenorm.data_gen.meshing.polygonise import gradients, projected
from cascadenorm.data_gen.shapes.fields import DistanceField
from cascadenorm.mesh import Mesh, Vectors, unit

CONVERGED = 0.02  # of the size of a cell: how far from the surface a point that was moved to it may end
FARTHEST_CELLS = 3.0  # cells between a face and the part of the surface that it stands for


class Measured(NamedTuple):
    """The same faces over vertices as they were measured, and over the points of the shape beneath them.

    normals : (m, 3), what the normal of each face of the noisy mesh should be; zero where that is not known
    """

    noisy: Mesh
    clean: Mesh
    normals: Vectors

    @classmethod
    def on_surface(cls, noisy: Mesh, clean: Mesh) -> "Measured":
        """Pair meshes of which each face of the clean one is the truth of the noisy one's."""
        return cls(noisy, clean, clean.face_normals)


def beneath(field: DistanceField, noisy: Mesh, *, cell: float) -> Measured:
    """Find the truth of a mesh that does not share its triangles with the shape, as one of voxels.

    The truth of a vertex is the nearest point of the shape, found by following the gradient of its field. That of a
    face is the direction of the gradient at the point nearest to its centroid.

    Parameters
    ----------
    field
        The shape, a signed distance near its surface.
    noisy
        m faces about it.
    cell
        Length of the details that the measurement resolves, such as the edge of a voxel.
    """
    points = projected(field, np.concatenate([noisy.vertices, noisy.centroids]), size=cell, steps=8)
    vertices, feet = np.split(points, [len(noisy.vertices)])
    slope = gradients(field, feet, step=1e-3 * cell)
    found = np.abs(field(feet)) < CONVERGED * cell
    near = np.linalg.norm(feet - noisy.centroids, axis=1) < FARTHEST_CELLS * cell
    known = found & near & (np.einsum("ij,ij->i", slope, slope) > 0.1) & (noisy.areas > 0)
    return Measured(noisy, noisy.moved(vertices), np.where(known[:, None], unit(slope), 0.0))
