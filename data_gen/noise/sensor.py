"""Error of a depth camera: noise that reaches over several pixels, and depths rounded in disparity."""

import numpy as np
from scipy import sparse

from cascadenorm.data_gen.shapes.fields import Values
from cascadenorm.data_gen.shapes.placement import random_direction
from cascadenorm.mesh import Mesh, Vectors, unit

WIDEST_SENSOR_NOISE = 60  # passes of neighbour means that spread noise: over about six pixels
LEAST_SHARE = 0.05  # of the variance, for each of white noise, spread noise and rounding
LEAST_FACING = 1e-3  # of the area of a sheet that faces the camera
HIGHEST_STEPS = 5.0  # rounding steps are up to so many times as high as for terraces of a pixel


def sensor_displacements(mesh: Mesh, deviation: float, *, rng: np.random.Generator) -> Vectors:
    """Displace vertices along the direction of view: the mean normal of a sheet, any direction for a closed surface.

    Neighbours err alike, since a camera matches windows of pixels, and where a surface is steep against the view,
    rounding of the disparity makes terraces (Khoshelham, Elberink 2012; Barron, Malik 2013). So the whole error may be
    several times larger than it is from one pixel to the next.

    Parameters
    ----------
    mesh
        A sheet seen from one side, or a surface from all.
    deviation
        About that of the error from one vertex to the next, a length; white noise of this standard deviation differs as
        much between neighbours.

    Returns
    -------
    (n, 3) float64, parallel rows
    """
    mean = mesh.area_vectors.sum(axis=0)
    closed = np.linalg.norm(mean) < LEAST_FACING * mesh.area
    toward = random_direction(rng=rng) if closed else unit(mean[None])[0]
    depth = -mesh.vertices @ toward
    distance = depth + float(rng.uniform(1.5, 6)) * mesh.diagonal - depth.mean()
    return np.asarray(camera_errors(distance, mesh, deviation, rng=rng)[:, None] * toward)


def camera_errors(distance: Values, pixels: Mesh, deviation: float, *, rng: np.random.Generator) -> Values:
    """Errors toward the camera, (n,), of the distances that the n pixels see, which are the vertices of a sheet."""
    if deviation == 0:
        return np.zeros(len(distance))
    blur = neighbor_means(pixels)
    shares = LEAST_SHARE + (1 - 3 * LEAST_SHARE) * rng.dirichlet((1, 1, 1))
    white, spread, rounding = deviation * np.sqrt(shares)
    wide = blurred(rng.normal(size=len(distance)), blur, round(WIDEST_SENSOR_NOISE ** rng.uniform()))
    ends = wide[pixels.topology.edges]
    wide /= np.sqrt(0.5 * np.mean((ends[:, 0] - ends[:, 1]) ** 2))
    seen = blurred(distance, blur, int(rng.integers(0, 3))) + white * rng.normal(size=len(distance)) + spread * wide
    # of the disparity 1 / distance
    step = np.sqrt(12) * rounding * HIGHEST_STEPS ** rng.uniform() / np.mean(distance) ** 2
    phase = float(rng.random())
    rounded = 1 / (step * np.maximum(np.round(1 / (seen * step) + phase) - phase, 0.5))
    return distance - blurred(rounded, blur, int(rng.integers(0, 3)))


def blurred(values: Values, means: sparse.csr_matrix, passes: int) -> Values:
    """Average values, one row a vertex, over neighbours so many times."""
    for _ in range(passes):
        values = means @ values
    return values


def neighbor_means(mesh: Mesh) -> sparse.csr_matrix:
    """Matrix that averages each vertex with its neighbours."""
    neighbors = mesh.topology.vertex_neighbors
    count = len(mesh.vertices)
    matrix = sparse.csr_matrix((np.ones(len(neighbors.indices)), neighbors.indices, neighbors.indptr), (count, count))
    matrix = matrix + sparse.identity(count, format="csr")
    return sparse.diags(1 / np.asarray(matrix.sum(axis=1)).ravel()) @ matrix
