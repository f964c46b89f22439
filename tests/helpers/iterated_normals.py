"""Face normals after many bilateral passes, and the weights of these."""

import numpy as np

from cascadenorm.baselines.iterated_bilateral import iterated_bilateral_normals
from cascadenorm.learned.descriptors import ITERATED_64, ITERATED_SIGMA_R
from cascadenorm.mesh import Mesh


def iterated(mesh: Mesh) -> np.ndarray:
    """Iterated bilateral normals as the first stage has them."""
    own = mesh.face_normals.astype(np.float32)[:, None]
    each = iterated_bilateral_normals(mesh, sigma_r=ITERATED_SIGMA_R, passes=ITERATED_64)
    return np.concatenate([own, *(normals.copy() for normals in each)], axis=1)


def compact(guide: np.ndarray, sigma_r: float) -> np.ndarray:
    """The weight (1 - u/8)^8 that stands for e^-u, (m, m)."""
    u = 0.5 * ((guide[:, None] - guide) ** 2).sum(axis=2) / sigma_r**2
    return np.maximum(1 - u / 8, 0) ** 8
