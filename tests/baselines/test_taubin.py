"""Taubin smoothing scales frequencies as its formula says and keeps the volume."""

import numpy as np
import pytest
from flows import spectrally
from shapes import icosphere, noisy

from cascadenorm.baselines.diffusion import laplacian
from cascadenorm.baselines.taubin import opposite_step, taubin
from cascadenorm.errors import ParameterError

MESH = noisy(icosphere(2), 0.15)


@pytest.mark.parametrize("step, pass_band, iterations", [(0.5, 0.1, 10), (0.33, 0.05, 3)])
def test_frequencies_are_scaled_by_the_transfer_function(step, pass_band, iterations):
    mu = 1 / (pass_band - 1 / step)
    expected = spectrally(MESH, "uniform", lambda k: ((1 - step * k) * (1 - mu * k)) ** iterations)
    found = taubin(MESH, step=step, pass_band=pass_band, iterations=iterations)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_pass_band_is_where_the_transfer_function_is_one_again():
    mu = opposite_step(0.6, 0.1)
    assert mu < -0.6
    assert 1 / 0.6 + 1 / mu == pytest.approx(0.1)
    assert (1 - 0.6 * 0.1) * (1 - mu * 0.1) == pytest.approx(1)


def test_sphere_keeps_its_volume_where_laplacian_smoothing_shrinks_it():
    rough = noisy(icosphere(4), 0.1)
    clean = icosphere(4).volume
    smooth = rough.moved(taubin(rough, iterations=30))
    shrunk = rough.moved(laplacian(rough, weights="uniform", scheme="explicit", step=0.5, iterations=60))
    assert smooth.volume == pytest.approx(clean, rel=0.01)
    assert shrunk.volume < 0.9 * clean
    roughness = np.linalg.norm(rough.vertices, axis=1).std()
    assert np.linalg.norm(smooth.vertices, axis=1).std() < 0.4 * roughness


def test_steps_that_do_not_pass_are_refused():
    with pytest.raises(ParameterError, match="product must be below 1"):
        taubin(MESH, step=1.0, pass_band=1.2)
    with pytest.raises(ParameterError, match="take a smaller step"):
        taubin(MESH, step=0.8, pass_band=0.1)
    with pytest.raises(ParameterError, match="multiply frequencies within the pass band by 34"):
        taubin(MESH, pass_band=1.0)
    taubin(MESH, pass_band=1.0, iterations=5)


def test_vertices_outside_the_region_stay():
    region = MESH.vertices[:, 0] > 0
    moved = taubin(MESH, region=region)
    assert ((moved == MESH.vertices).all(axis=1) == ~region).all()
