"""Equal rows, as a hash table finds them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cascadenorm.compute.equal_rows import PRIME, _find_equal, first_equal, repeats


@given(st.lists(st.tuples(*[st.sampled_from([-1.5, -0.0, 0.0, 2.0, 1e300])] * 3), max_size=30))
def test_repeated_rows_refer_to_the_first_equal_one(rows):
    array = np.array(rows, np.float64).reshape(-1, 3)
    repeated, first = repeats(array)
    expected = [rows.index(row) for row in rows]
    np.testing.assert_array_equal(first, expected)
    np.testing.assert_array_equal(repeated, np.arange(len(rows)) != expected)


def test_coordinates_made_for_equal_hashes_are_told_apart_with_few_probes():
    """Both halves of each number differ alike, as the folds of simple hashes cannot tell."""
    high = (0x3FF00000 + 16 * np.arange(3000)).astype(np.uint64)
    crafted = ((high << np.uint64(32)) | (high ^ np.uint64(0x12345678))).view(np.float64)
    rows = np.column_stack([np.full(3000, 0.5), np.full(3000, 0.25), crafted])
    assert first_equal(rows) is None
    same, repeated = first_equal(np.concatenate([rows, rows[::-1]]))
    assert np.array_equal(same, np.concatenate([np.arange(3000), np.arange(3000)[::-1]])) and repeated.all()
    assert longest_run(rows) < 60


def longest_run(rows) -> int:
    """Most neighbouring places of the table that are taken: no search probes more."""
    bits = np.ascontiguousarray(rows).view(np.int64)
    places = np.full(2 << len(rows).bit_length(), -1, np.int32)
    factors = np.random.default_rng(1).integers(1, PRIME, 3 * rows.shape[1])
    _find_equal(bits, factors, places, np.empty(len(rows), np.int64), np.zeros(len(rows), bool))
    free = np.flatnonzero(places < 0)
    return int(np.diff(free).max()) - 1


@pytest.mark.parametrize("columns", [1, 2, 3, 4])
def test_the_same_rows_are_equal_in_single_and_double_precision(columns):
    rows = np.random.default_rng(columns).choice([0.0, -0.0, 0.1, 2.0, np.nan], (300, columns)).astype(np.float32)
    for single, double in zip(first_equal(rows), first_equal(rows.astype(float)), strict=True):
        np.testing.assert_array_equal(single, double)
    same, _ = first_equal(rows)
    np.testing.assert_array_equal(rows[same], rows)
