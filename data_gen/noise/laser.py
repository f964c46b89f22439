"""Error of a laser scanner along the viewing direction.

It is correlated over one or two steps of the grid.
"""

import numpy as np

from cascadenorm.data_gen.noise.relief import log_uniform
from cascadenorm.data_gen.noise.sensor import blurred, neighbor_means
from cascadenorm.mesh import Mesh, Vectors

LEVELS = 0.04, 0.25  # standard deviation in mean edge lengths
MOST_WHITE = 0.6  # largest share of the variance that is independent per vertex
STEEPEST_VIEW = 0.2  # least cosine between viewing direction and normal; steeper parts have the same error
BOUNDARY_RATIO = 1.0, 5.0  # ratio of the error at the boundary to that within the sheet
BOUNDARY_PASSES = 1, 5  # averages over neighbours over which the larger error at the boundary fades out


def laser_displacements(mesh: Mesh, deviation: float, *, rng: np.random.Generator) -> Vectors:
    """Displace the vertices of a sheet along the viewing direction, which is its mean normal.

    The errors of triangulating scanners grow on steep surfaces and beside jumps in depth, where only part of the laser
    stripe meets the surface. Neighbouring samples share part of the stripe (Curless, Levoy 1995). Their root mean
    square is `deviation`, in mesh units. Returns (n, 3) displacements in parallel rows.
    """
    mean = mesh.area_vectors.sum(axis=0)
    toward = mean / max(float(np.linalg.norm(mean)), np.finfo(float).tiny)
    means = neighbor_means(mesh)
    white = rng.normal(size=len(mesh.vertices))
    share = rng.uniform(0, MOST_WHITE)
    wide = blurred(rng.normal(size=len(white)), means, int(rng.choice([1, 2], p=[2 / 3, 1 / 3])))
    error = np.sqrt(share) * white + np.sqrt(1 - share) * wide / wide.std()
    error *= np.maximum(mesh.vertex_normals @ toward, STEEPEST_VIEW) ** -rng.uniform(0, 1)
    boundary = mesh.topology.boundary_vertices.astype(np.float64)
    near = blurred(boundary, means, int(rng.integers(*BOUNDARY_PASSES)))
    error *= 1 + (log_uniform(BOUNDARY_RATIO, rng=rng) - 1) * near / max(near.max(), np.finfo(float).tiny)
    error *= deviation / np.sqrt(np.mean(error**2))
    return np.asarray(error[:, None] * toward)
