"""Exponentials and logarithms of kernels against those of numpy in double precision."""

import numpy as np
import pytest

from cascadenorm.compute.elementary import exp, expf, logf


def values(function, numbers):
    return np.array([function(number) for number in numbers], np.float64)


def test_exponential_agrees_to_the_last_bits_and_vanishes_far_below_zero():
    numbers = np.concatenate([-np.geomspace(1e-12, 707, 2000), np.linspace(-2, 700, 2000)])
    np.testing.assert_allclose(values(exp, numbers), np.exp(numbers), rtol=5e-16)
    assert exp(0.0) == 1 and exp(-709.0) == exp(-np.inf) == 0 and np.isnan(exp(np.nan))


@pytest.mark.parametrize(("largest", "tolerance"), [(8, 1e-6), (87, 5e-6)])
def test_exponential_in_single_precision(largest, tolerance):
    numbers = np.linspace(-largest, largest, 4001).astype(np.float32)
    np.testing.assert_allclose(values(expf, numbers), np.exp(numbers.astype(np.float64)), rtol=tolerance)


def test_exponential_in_single_precision_stays_finite():
    assert expf(np.float32(0)) == pytest.approx(1, abs=2e-7)
    assert 0 < expf(np.float32(-1000)) < 1e-37 and 1e37 < expf(np.float32(1000)) < np.inf


def test_logarithm_in_single_precision():
    numbers = np.concatenate([np.geomspace(1e-4, 1e4, 4001), np.linspace(0.5, 2, 2001)]).astype(np.float32)
    np.testing.assert_allclose(values(logf, numbers), np.log(numbers.astype(np.float64)), atol=2e-6)
    assert logf(np.float32(1)) == 0
