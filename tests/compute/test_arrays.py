import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cascadenorm.mesh import pair_products, scatter_add, vectors


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


def test_products_of_pairs_are_those_of_numpy():
    rng = np.random.default_rng(0)
    rows, pairs = rng.normal(size=(40, 3)), rng.integers(0, 40, (900, 2)).astype(np.int32)
    first, second = rows[pairs.T]
    np.testing.assert_allclose(pair_products(rows, pairs), (first * second).sum(axis=1), rtol=0, atol=1e-14)
