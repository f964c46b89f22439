"""Mean, unilateral, random-walk and median filters of normals equal their formulas."""

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import grid, icosphere, noisy

from cascadenorm.baselines.mean_normal import mean_normal, median_pass, unilateral_normals, walk_means
from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.mesh import unit

ROUGH = noisy(icosphere(2), 0.2)
RINGS = ROUGH.topology.face_rings(1)


def test_mean_is_that_of_the_area_vectors():
    around = [np.append(RINGS.row(f), f) for f in range(len(ROUGH.faces))]
    normals = unit(np.array([ROUGH.area_vectors[g].sum(axis=0) for g in around]))
    ours = mean_normal(ROUGH, iterations=1, sweeps=5)
    np.testing.assert_allclose(ours, recover_vertices(ROUGH, normals, sweeps=5), atol=1e-12)


@settings(max_examples=10)
@given(st.floats(-1, 0.99))
def test_unilateral_pass_equals_its_formula(threshold):
    ours = unilateral_normals(ROUGH, threshold=threshold, iterations=1)
    np.testing.assert_allclose(
        ours, reference.unilateral_pass(ROUGH.face_normals, RINGS, threshold), rtol=0, atol=1e-12
    )


def test_unilateral_with_a_threshold_next_to_one_changes_nothing():
    ours = unilateral_normals(ROUGH, threshold=1 - 1e-12, iterations=1)
    np.testing.assert_allclose(ours, ROUGH.face_normals, atol=1e-12)


@pytest.mark.parametrize("length", [0, 1, 4])
def test_a_walk_visits_with_the_powers_of_its_matrix(length):
    expected = (
        np.linalg.matrix_power(reference.walk_matrix(ROUGH.face_normals, RINGS, 0.5), length) @ ROUGH.face_normals
    )
    ours = walk_means(ROUGH.face_normals, RINGS, sigma_r=0.5, length=length)
    np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-12)


def test_a_long_walk_that_likes_all_normals_forgets_where_it_came_from():
    degree = RINGS.counts + 1  # of its stationary distribution
    ours = walk_means(ROUGH.face_normals, RINGS, sigma_r=np.inf, length=1000)
    np.testing.assert_allclose(ours, np.tile(degree @ ROUGH.face_normals / degree.sum(), (len(ours), 1)), atol=1e-9)


@pytest.mark.parametrize("median", ["vector", "angle"])
@settings(max_examples=10)
@given(st.integers(0, 1000))
def test_a_pass_equals_its_formula(median, seed):
    rough = noisy(icosphere(1), 0.3, seed=seed)
    ours = median_pass(rough, rough.face_normals, median=median)
    expected = reference.median_pass(rough, rough.topology.face_rings(1), median)
    np.testing.assert_array_equal(ours, expected)


def test_an_outlier_goes_and_leaves_no_trace():
    sheet = grid(8, 8)
    normals = sheet.face_normals.copy()
    normals[60] = 1, 0, 0
    np.testing.assert_array_equal(median_pass(sheet, normals, median="vector"), sheet.face_normals)


def test_an_edge_stays_where_a_mean_would_round_it():
    sheet = grid(8, 8)
    normals = np.where(sheet.centroids[:, :1] < 4, [[0.0, 0, 1]], [[1.0, 0, 0]])
    for median in ("vector", "angle"):
        np.testing.assert_array_equal(median_pass(sheet, normals, median=median), normals)
