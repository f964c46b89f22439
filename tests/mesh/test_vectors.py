"""Operations on vectors in kernels agree with numpy."""

import numpy as np

from cascadenorm.mesh import vectors


def test_vector_kernels_agree_with_numpy():
    rng = np.random.default_rng(0)
    for u, v in rng.normal(size=(20, 2, 3)):
        a, b = vectors.row(np.stack([v, u]), 1), tuple(v)
        np.testing.assert_array_equal(vectors.add(a, b), u + v)
        np.testing.assert_array_equal(vectors.subtract(u, b), u - v)  # rows may stand for vectors
        np.testing.assert_allclose(vectors.dot(a, b), u @ v, atol=1e-15)
        np.testing.assert_allclose(vectors.cross(a, b), np.cross(u, v), atol=1e-15)
        np.testing.assert_allclose(vectors.length(a), np.linalg.norm(u), rtol=1e-15)
        np.testing.assert_allclose(vectors.squared_distance(a, b), ((u - v) ** 2).sum(), rtol=1e-14)
