"""Operations on rows of arrays are those of numpy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from cascadenorm.compute.arrays import first_of_each
from cascadenorm.mesh import pair_products, scatter_add


@given(st.integers(0, 40), st.sampled_from([(), (1,), (3,), (3, 3)]), st.sampled_from([np.int32, np.int64]), st.data())
def test_scatter_add_is_a_loop_over_the_rows(count, shape, kind, data):
    rng = np.random.default_rng(data.draw(st.integers(0, 99)))
    index, values = rng.integers(0, 7, count).astype(kind), rng.normal(size=(count, *shape))
    expected = np.zeros((9, *shape))
    for i, place in enumerate(index):
        expected[place] += values[i]
    np.testing.assert_array_equal(scatter_add(index, values, 9), expected)  # in the same order, so to the last digit


@pytest.mark.parametrize("kind", [bool, np.int8, np.int32, np.float32])
def test_scatter_add_sums_any_kind_of_number_in_double_precision(kind):
    ones = np.ones(300, kind)
    assert scatter_add(np.zeros(300, int), ones, 2).tolist() == [300.0, 0.0]
    tenth = np.full(1000, np.float32(0.1))
    assert scatter_add(np.zeros(1000, int), tenth, 1)[0] == pytest.approx(1000 * float(np.float32(0.1)), rel=1e-12)


def test_scatter_add_takes_views_of_any_layout():
    values, index = np.arange(24.0).reshape(4, 6)[:, ::2], np.array([[1, 9], [0, 9], [1, 9], [2, 9]])[:, 0]
    np.testing.assert_array_equal(scatter_add(index, values, 3), [values[1], values[0] + values[2], values[3]])


def test_products_of_pairs_are_those_of_numpy():
    rng = np.random.default_rng(0)
    rows, pairs = rng.normal(size=(40, 3)), rng.integers(0, 40, (900, 2)).astype(np.int32)
    first, second = rows[pairs.T]
    np.testing.assert_allclose(pair_products(rows, pairs), (first * second).sum(axis=1), rtol=0, atol=1e-14)


def test_the_first_place_of_each_label_is_that_of_numpy():
    labels = np.array([0, 2, 0, 1, 2, 2, 1, 3])
    assert_array_equal(first_of_each(labels), np.unique(labels, return_index=True)[1])
    assert len(first_of_each(labels[:0])) == 0
