"""Approximate harmonics are near the exact ones, and none has too small a value."""

import numpy as np
import pytest
from shapes import icosphere, noisy

from cascadenorm.errors import ParameterError
from cascadenorm.geometry.spectra.fast_harmonics import fast_harmonics
from cascadenorm.geometry.spectra.harmonics import manifold_harmonics
from cascadenorm.mesh import Mesh

MESH = noisy(icosphere(4), 0.1)


@pytest.mark.parametrize("samples, noise", [(800, 0.1), (200, 0.0), (300, 0.2)])
def test_lower_half_of_the_eigenvalues_is_within_two_percent_and_none_is_below(samples, noise):
    mesh = noisy(icosphere(4), noise)
    exact, fast = manifold_harmonics(mesh, 100).values, fast_harmonics(mesh, 100, samples=samples).values
    error = fast[1:] / exact[1:] - 1
    assert error.min() > -1e-9
    assert error[:50].max() < 0.02
    assert fast[0] == pytest.approx(0, abs=1e-9)


def test_eigenvectors_are_orthonormal_and_near_the_exact_ones():
    fast, exact = fast_harmonics(MESH, 30, samples=500), manifold_harmonics(MESH, 30)
    np.testing.assert_allclose(fast.coefficients(fast.vectors), np.eye(30), atol=1e-9)
    overlap = exact.coefficients(fast.vectors)
    assert (overlap[:25, :16] ** 2).sum(axis=0).min() > 0.995  # of three whole clusters of the sphere


def test_every_connected_part_is_sampled():
    ball = icosphere(1)
    mesh = Mesh(
        np.concatenate([ball.vertices, [[9, 9, 9]], ball.vertices + 4]), np.concatenate([ball.faces, ball.faces + 43])
    )
    values = fast_harmonics(mesh, 3, samples=12).values
    assert values[:2] == pytest.approx(0, abs=1e-9) and values[2] > 0.1


def test_with_nearly_as_many_samples_as_vertices_the_pairs_are_exact():
    small = noisy(icosphere(2), 0.2)
    np.testing.assert_array_equal(fast_harmonics(small, 20).values, manifold_harmonics(small, 20).values)


def test_more_harmonics_than_samples_are_refused():
    with pytest.raises(ParameterError, match="samples is 50; it must be at least 51"):
        fast_harmonics(MESH, 51, samples=50)
