"""Low-frequency drift, which no normal tells of, taken out of the vertices after the last update."""

import numpy as np

from cascadenorm.mesh import Csr, Floats, Mesh, Vectors, kernel, parallel_for

PASSES = 64


def without_drift(mesh: Mesh, vertices: Vectors, *, passes: int = PASSES) -> Vectors:
    """Take back of a displacement along the normals what is smooth.

    Normals determine vertices up to what varies slowly, and the vertex update leaves such errors. Noise has hardly any:
    a mean of a displacement over many vertices is drift. It is found by averaging each vertex with its neighbours
    `passes` times, which keeps waves longer than about ten edges for 64.

    Parameters
    ----------
    mesh : the input, n vertices
    vertices : (n, 3), where they have been moved

    Returns
    -------
    (n, 3); a vertex without a face stays where it has been moved
    """
    normals = mesh.moved(vertices).vertex_normals
    drift = np.einsum("ij,ij->i", vertices - mesh.vertices, normals)
    spare = np.empty_like(drift)
    for _ in range(passes):
        parallel_for(len(drift), _mean_range, drift, mesh.topology.vertex_neighbors, spare)
        drift, spare = spare, drift
    return np.asarray(vertices - drift[:, None] * normals)


@kernel
def _mean_range(start: int, stop: int, values: Floats, neighbors: Csr, out: Floats) -> None:
    for i in range(start, stop):
        total = values[i]
        for k in range(neighbors.indptr[i], neighbors.indptr[i + 1]):
            total += values[neighbors.indices[k]]
        out[i] = total / (1 + neighbors.indptr[i + 1] - neighbors.indptr[i])
