"""Low-frequency drift, which no normal tells of, taken out of the vertices after the last update."""

import numpy as np

from cascadenorm.mesh import Mesh, Vectors
from cascadenorm.mesh.averages import averaged

DRIFT_PASSES = 64


def without_drift(mesh: Mesh, vertices: Vectors, *, passes: int = DRIFT_PASSES) -> Vectors:
    """Take back of a displacement along the normals what is smooth.

    Normals determine vertices up to what varies slowly, and the vertex update leaves such errors. Noise has hardly any:
    a mean of a displacement over many vertices is drift. It is found by averaging each vertex with its neighbours
    `passes` times, which keeps waves longer than about ten edges for 64.

    Parameters
    ----------
    mesh
        The input, n vertices.
    vertices
        (n, 3), where they have been moved.

    Returns
    -------
    (n, 3); a vertex without a face stays where it has been moved
    """
    normals = mesh.moved(vertices).vertex_normals
    drift = np.einsum("ij,ij->i", vertices - mesh.vertices, normals)
    drift = averaged(drift, mesh.topology.vertex_neighbors, passes)
    return np.asarray(vertices - drift[:, None] * normals)
