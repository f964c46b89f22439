import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import grid, icosphere, noisy

from cascadenorm.baselines.median_normal import median_pass


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
