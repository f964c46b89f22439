"""Meshes to denoise in patches."""

import numpy as np
from shapes import grid, icosphere, noisy

from cascadenorm.mesh import Mesh

AGREES = 1e-5  # of an edge; rounding in products of matrices, made larger by what follows
RIBBON = noisy(grid(400, 6), 0.1, seed=4)  # without triangles so thin that rounding turns them, on any processor
"""Much longer than a halo is wide, so that patches are parts of it."""
BALL = noisy(icosphere(4), 0.2)
EXACT = {
    "taubin": {"iterations": 5},
    "laplacian": {"iterations": 3},
    "bilateral-normal": {"iterations": 4},
    "mean-normal": {},
    "median-normal": {"iterations": 2},
    "unilateral-normal": {"iterations": 3},
    "random-walk-normal": {"iterations": 2},
    "guided-normal": {"iterations": 2},
}
"""Methods of which each result is the same to the last bit, and parameters that save time."""


def shuffled(mesh: Mesh) -> Mesh:
    """Return a mesh with vertices and faces in random order."""
    rng = np.random.default_rng(0)
    numbers = rng.permutation(len(mesh.vertices))
    return Mesh(mesh.vertices[numbers], rng.permutation(np.argsort(numbers).astype(np.int32)[mesh.faces]))
