"""Errors of depth cameras and laser scanners along the viewing direction."""

import numpy as np
from scipy import sparse

from cascadenorm.data_gen.shapes.fields import Values
from cascadenorm.data_gen.shapes.placement import log_uniform, random_direction
from cascadenorm.mesh import Mesh, Vectors, unit

# largest number of neighbour averages that spread the noise, which then extends over about six pixels
WIDEST_SENSOR_NOISE = 60
LEAST_SHARE = 0.05  # least share of the variance of white noise, of spread noise and of rounding
LEAST_FACING = 1e-3  # a sheet faces the camera if its mean area vector exceeds this share of its area
HIGHEST_STEPS = 5.0  # largest height of rounding steps, relative to terraces one pixel wide
LASER_LEVELS = 0.04, 0.25  # standard deviation of the error of a laser scanner, in mean edge lengths
MOST_WHITE = 0.6  # largest share of the variance that is independent per vertex
STEEPEST_VIEW = 0.2  # least cosine between viewing direction and normal; steeper parts have the same error
BOUNDARY_RATIO = 1.0, 5.0  # ratio of the error at the boundary to that within the sheet
FADE_PASSES = 1, 5  # averages over neighbours over which the larger error at the boundary fades out


def sensor_displacements(mesh: Mesh, deviation: float, rng: np.random.Generator) -> Vectors:
    """Displace the vertices of a sheet seen from one side, or of a closed surface, along the viewing direction.

    The viewing direction is the mean normal of a sheet, or random for a closed surface. Errors of neighbours are
    correlated, since a camera matches windows of pixels. Where the surface is steep to the view, rounding of the
    disparity makes terraces (Khoshelham, Elberink 2012; Barron, Malik 2013). The whole error can therefore be several
    times larger than its difference between neighbouring pixels. That is about as large as the difference of white
    noise with the standard deviation `deviation`, in mesh units. Returns (n, 3) displacements in parallel rows.
    """
    toward = _viewing_direction(mesh, rng=rng)
    depth = -mesh.vertices @ toward
    distance = depth + rng.uniform(1.5, 6) * mesh.diagonal - depth.mean()
    return np.asarray(camera_errors(distance, mesh, deviation, rng=rng)[:, None] * toward)


def laser_displacements(mesh: Mesh, deviation: float, rng: np.random.Generator) -> Vectors:
    """Displace the vertices of a sheet along its mean normal, or of a closed surface along a random direction.

    The errors of triangulating scanners grow on steep surfaces and beside jumps in depth, where only part of the laser
    stripe meets the surface. Neighbouring samples share part of the stripe (Curless, Levoy 1995). Their root mean
    square is `deviation`, in mesh units. Returns (n, 3) displacements in parallel rows.
    """
    toward = _viewing_direction(mesh, rng=rng)
    means = neighbor_means(mesh)
    white = rng.normal(size=len(mesh.vertices))
    share = rng.uniform(0, MOST_WHITE)
    wide = blurred(rng.normal(size=len(white)), means, int(rng.choice([1, 2], p=[2 / 3, 1 / 3])))
    error = np.sqrt(share) * white + np.sqrt(1 - share) * wide / wide.std()
    error *= np.maximum(mesh.vertex_normals @ toward, STEEPEST_VIEW) ** -rng.uniform(0, 1)
    boundary = mesh.topology.boundary_vertices.astype(np.float64)
    near = blurred(boundary, means, int(rng.integers(*FADE_PASSES)))
    error *= 1 + (log_uniform(BOUNDARY_RATIO, rng=rng) - 1) * near / max(near.max(), np.finfo(float).tiny)
    error *= deviation / np.sqrt(np.mean(error**2))
    return np.asarray(error[:, None] * toward)


def _viewing_direction(mesh: Mesh, *, rng: np.random.Generator) -> Vectors:
    """Return the mean normal of a sheet, (3,), or a random direction for a closed surface, which has none."""
    mean = mesh.area_vectors.sum(axis=0)
    closed = np.linalg.norm(mean) < LEAST_FACING * mesh.area
    return random_direction(rng=rng) if closed else unit(mean[None])[0]


def camera_errors(distance: Values, pixels: Mesh, deviation: float, *, rng: np.random.Generator) -> Values:
    """Return the errors toward the camera, (n,), of the distances at n pixels, the vertices of a sheet."""
    if deviation == 0:
        return np.zeros(len(distance))
    blur = neighbor_means(pixels)
    shares = LEAST_SHARE + (1 - 3 * LEAST_SHARE) * rng.dirichlet((1, 1, 1))
    white, spread, rounding = deviation * np.sqrt(shares)
    wide = blurred(rng.normal(size=len(distance)), blur, round(WIDEST_SENSOR_NOISE ** rng.uniform()))
    ends = wide[pixels.topology.edges]
    wide /= np.sqrt(0.5 * np.mean((ends[:, 0] - ends[:, 1]) ** 2))
    seen = blurred(distance, blur, int(rng.integers(0, 3))) + white * rng.normal(size=len(distance)) + spread * wide
    # The rounding step applies to the disparity, 1 / distance.
    step = np.sqrt(12) * rounding * HIGHEST_STEPS ** rng.uniform() / np.mean(distance) ** 2
    phase = rng.random()
    rounded = 1 / (step * np.maximum(np.round(1 / (seen * step) + phase) - phase, 0.5))
    return distance - blurred(rounded, blur, int(rng.integers(0, 3)))


def blurred(values: Values, means: sparse.csr_matrix, passes: int) -> Values:
    """Average values, one row per vertex, over neighbours `passes` times."""
    for _ in range(passes):
        values = means @ values
    return values


def neighbor_means(mesh: Mesh) -> sparse.csr_matrix:
    """Return the matrix that averages each vertex with its neighbours."""
    neighbors = mesh.topology.vertex_neighbors
    count = len(mesh.vertices)
    matrix = sparse.csr_matrix((np.ones(len(neighbors.indices)), neighbors.indices, neighbors.indptr), (count, count))
    matrix = matrix + sparse.identity(count, format="csr")
    return sparse.diags(1 / np.asarray(matrix.sum(axis=1)).ravel()) @ matrix
