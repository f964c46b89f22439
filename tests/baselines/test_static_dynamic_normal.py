"""Each pass of the filter equals its formula and lowers its energy."""

from functools import partial

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.baselines.guided_normal import patch_guidance
from cascadenorm.baselines.static_dynamic_normal import descended, static_dynamic_normal, weighted_pairs
from cascadenorm.mesh import unit

ROUGH = noisy(icosphere(2), 0.2)
GUIDE = patch_guidance(ROUGH)
SETTINGS = {"smoothness": 2.0, "sigma_s": 0.7, "sigma_g": 0.8, "sigma_r": 0.4}


def descent(mesh, guide, *, sigma_r, **given):
    """The function that takes normals of a mesh through one pass."""
    return partial(descended, mesh, pairs=weighted_pairs(mesh, guide, **given), sigma_r=sigma_r)


def filtered(mesh, guide, passes, **given):
    one_pass, normals = descent(mesh, guide, **{**SETTINGS, **given}), mesh.face_normals
    for _ in range(passes):
        normals = one_pass(normals)
    return normals


@settings(max_examples=5)
@given(st.integers(0, 1000), st.floats(0.1, 2.0), st.floats(0.1, 5.0))
def test_a_pass_equals_its_formula(seed, sigma_r, smoothness):
    mesh = noisy(icosphere(1), 0.3, seed=seed)
    given = {**SETTINGS, "sigma_r": sigma_r, "smoothness": smoothness}
    guide = patch_guidance(mesh)
    one_pass, normals = descent(mesh, guide, **given), mesh.face_normals
    for _ in range(2):  # of which the second one begins away from the given normals
        expected = reference.static_dynamic_pass(mesh, guide, normals, **given)
        normals = one_pass(normals)
        np.testing.assert_allclose(normals, expected, atol=1e-11)


@pytest.mark.parametrize("sigma_r", [0.2, 0.4, 1.5])
def test_the_energy_falls_with_each_pass_until_it_is_stationary(sigma_r):
    given = {**SETTINGS, "sigma_r": sigma_r}
    one_pass, normals = descent(ROUGH, GUIDE, **given), ROUGH.face_normals
    energies = [reference.static_dynamic_energy(ROUGH, GUIDE, normals, **given)]
    for _ in range(10):
        normals = one_pass(normals)
        energies.append(reference.static_dynamic_energy(ROUGH, GUIDE, normals, **given))
    assert (np.diff(energies) < 0).all()
    for _ in range(2000):
        normals = one_pass(normals)
    rng, step = np.random.default_rng(0), 1e-5
    for _ in range(5):  # no way on the spheres on which the energy changes in first order
        way = rng.normal(size=normals.shape)
        ends = [
            reference.static_dynamic_energy(ROUGH, GUIDE, unit(normals + sign * step * way), **given)
            for sign in (1, -1)
        ]
        assert abs(ends[0] - ends[1]) / (2 * step) < 1e-4 * energies[0]


def test_without_smoothness_nothing_changes():
    np.testing.assert_allclose(filtered(ROUGH, GUIDE, 3, smoothness=0.0), ROUGH.face_normals, atol=1e-15)
    assert static_dynamic_normal(ROUGH, iterations=0).tobytes() == ROUGH.vertices.tobytes()


def test_with_wide_spreads_and_all_smoothness_a_pass_is_the_gaussian_mean_of_the_others():
    ours = filtered(ROUGH, GUIDE, 1, smoothness=1e12, sigma_g=1e9, sigma_r=1e3)
    near, c, a = reference.pairs_within(ROUGH, 3 * SETTINGS["sigma_s"]), ROUGH.centroids, ROUGH.areas
    distances = np.linalg.norm(c[:, None] - c, axis=2) / ROUGH.mean_edge_length
    weights = near * (a[:, None] + a) * np.exp(-0.5 * (distances / SETTINGS["sigma_s"]) ** 2)
    np.testing.assert_allclose(ours, unit(weights @ ROUGH.face_normals), atol=1e-5)


def test_the_guidance_alone_keeps_faces_apart_whatever_their_normals():
    sheet = grid(8, 8)
    left = sheet.centroids[:, 0] < 4
    halves = np.where(left[:, None], (1.0, 0, 0), (0, 0, 1.0))
    given = {"smoothness": SETTINGS["smoothness"], "sigma_s": SETTINGS["sigma_s"], "sigma_g": 0.05}
    (near, guided), (_, even) = (weighted_pairs(sheet, guide, **given) for guide in (halves, 0 * halves))
    across = left[near.rows] != left[near.indices]
    assert 0 < across.sum() < len(across) / 4
    assert guided[across].max() < 1e-80 < even.min()
    np.testing.assert_array_equal(guided[~across], even[~across])


@pytest.mark.parametrize("name", ["smoothness", "sigma_r"])
def test_weights_that_would_overflow_are_refused(name):
    assert np.isfinite(cn.denoise(ROUGH, method="static-dynamic-normal", iterations=1, **{name: 1e6}).vertices).all()
    with pytest.raises(cn.ParameterError, match=f"{name}.*at most 1e"):
        cn.denoise(ROUGH, method="static-dynamic-normal", **{name: np.inf})
