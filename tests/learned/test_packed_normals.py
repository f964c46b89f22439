"""Packed normals come back up to the rounding of single precision."""

from itertools import product

import numpy as np

from cascadenorm.learned.packed_normals import no_normals, pack, unpacked
from cascadenorm.mesh import unit


def test_packed_normals_differ_by_the_rounding_of_single_precision():
    rng = np.random.default_rng(0)
    some = unit(rng.normal(size=(2000, 3)))
    axes = np.concatenate(
        [np.eye(3), -np.eye(3), unit(np.array(list(product((-1, 0, 1), (-1, 0, 1), (-1, 1))), float))]
    )
    close = unit(axes + 1e-6 * rng.normal(size=axes.shape))
    normals = np.concatenate([some, axes, close, np.zeros((1, 3))]).astype(np.float32)
    packed = no_normals(len(normals), 2)
    pack(np.stack([normals, -normals], axis=1), packed)
    np.testing.assert_allclose(unpacked(packed), np.stack([normals, -normals], axis=1), atol=3e-7, rtol=0)
    np.testing.assert_array_equal(unpacked(packed)[-1], 0)
