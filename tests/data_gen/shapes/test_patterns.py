"""Patterns are bounded, continuous and set by their generator."""

import numpy as np
from distance_fields import points

from cascadenorm.data_gen.shapes import patterns


def test_noise_is_continuous_bounded_and_set_by_its_generator():
    at = points(9)
    same = [patterns.noise(wavelength=0.3, octaves=3, rng=np.random.default_rng(s))(at) for s in (1, 1, 2)]
    np.testing.assert_array_equal(same[0], same[1])
    assert not np.allclose(same[0], same[2])
    assert np.abs(same[0]).max() < 3
    assert np.abs(same[0].mean()) < 0.1
    pattern = patterns.noise(wavelength=0.3, rng=np.random.default_rng(1))
    assert np.abs(pattern(at + 1e-7) - pattern(at)).max() < 1e-5


def test_cells_know_the_nearest_two_of_the_scattered_points():
    at = points(10, count=200)
    seed = patterns.seed_of(np.random.default_rng(3))
    cells = np.stack(np.meshgrid(*[np.arange(-4, 4)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    drawn = [patterns._hash(*cell, seed) for cell in cells.tolist()]
    scattered = cells + np.array([[h & 1023, h >> 10 & 1023, h >> 20 & 1023] for h in drawn]) / 1024
    first, second = np.sort(np.linalg.norm(at[:, None] - scattered, axis=2), axis=1)[:, :2].T
    bumps, cracks = (
        patterns.cells(wavelength=1.0, kind=kind, rng=np.random.default_rng(3))(at) for kind in ("bumps", "cracks")
    )
    np.testing.assert_allclose(bumps, 1 - 2 * np.minimum(first, 1) ** 2, atol=1e-12)
    np.testing.assert_allclose(cracks, 2 * np.minimum((second - first) / 0.35, 1) - 1, atol=1e-12)
