"""Error of a depth camera: depths blurred sideways, disturbed by noise with some reach, rounded in disparity."""

import numpy as np
from scipy import sparse

from cascadenorm.data_gen.fields import Values
from cascadenorm.mesh import Mesh, Vectors, unit


def sensor_displacements(mesh: Mesh, deviation: float, *, rng: np.random.Generator) -> Vectors:
    """Displace vertices along the direction of view, which is taken to be the mean normal of the sheet.

    Parameters
    ----------
    mesh : a sheet seen from one side
    deviation : root mean square of the displacements, a length

    Returns
    -------
    (n, 3) float64, parallel rows
    """
    toward = unit(mesh.area_vectors.sum(axis=0)[None])[0]
    depth = -mesh.vertices @ toward
    distance = depth + float(rng.uniform(1.5, 6)) * mesh.diagonal - depth.mean()
    blur = _neighbour_means(mesh)
    error = _blurred(rng.normal(size=len(depth)), blur, int(rng.integers(0, 4)))
    error *= deviation / error.std()
    seen = _blurred(distance, blur, int(rng.integers(0, 3))) + error
    step = deviation * float(rng.uniform(0.3, 3.5)) / np.mean(distance) ** 2  # of the disparity 1 / distance
    phase = float(rng.random())
    rounded = 1 / (step * (np.round(1 / (seen * step) + phase) - phase))
    moved = distance - rounded
    size = np.sqrt(np.mean(moved**2))
    return np.asarray((moved * (deviation / size if size > 0 else 0.0))[:, None] * toward)


def _blurred(values: Values, means: sparse.csr_matrix, passes: int) -> Values:
    for _ in range(passes):
        values = means @ values
    return values


def _neighbour_means(mesh: Mesh) -> sparse.csr_matrix:
    """Matrix that averages each vertex with its neighbours."""
    neighbors = mesh.topology.vertex_neighbors
    count = len(mesh.vertices)
    matrix = sparse.csr_matrix((np.ones(len(neighbors.indices)), neighbors.indices, neighbors.indptr), (count, count))
    matrix = matrix + sparse.identity(count, format="csr")
    return sparse.diags(1 / np.asarray(matrix.sum(axis=1)).ravel()) @ matrix
