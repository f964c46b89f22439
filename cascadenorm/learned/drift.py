"""Remove low-frequency drift from denoised vertices."""

import numpy as np

from cascadenorm.mesh import Mesh, Vectors
from cascadenorm.mesh.averages import averaged

DRIFT_PASSES = 64


def without_drift(mesh: Mesh, vertices: Vectors, *, passes: int = DRIFT_PASSES) -> Vectors:
    """Remove the smooth part of the displacement from a mesh to its denoised vertices, (n, 3), along the normals.

    Normals determine vertices only up to slow variations, so the vertex update leaves such errors. Noise has hardly any
    low-frequency part: the mean of a displacement over many vertices is drift. It is estimated by averaging each vertex
    with its neighbours `passes` times. 64 passes keep wavelengths above about ten edges. Returns (n, 3) vertices; those
    without a face, and those that have not moved, keep the given position.
    """
    normals = mesh.moved(vertices).vertex_normals
    drift = np.einsum("ij,ij->i", vertices - mesh.vertices, normals)
    drift = averaged(drift, mesh.topology.vertex_neighbors, passes)
    drift[(vertices == mesh.vertices).all(axis=1)] = 0
    return np.asarray(vertices - drift[:, None] * normals)
