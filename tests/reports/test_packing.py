"""Packed numbers come back as they were, or within half a step."""

import numpy as np
import pytest
from report_contents import CLEAN, unpacked

from cascadenorm.reports.packing import in_steps, packed, packed_faces


@pytest.mark.parametrize("differences", [False, True])
@pytest.mark.parametrize("shape", [(1,), (7,), (5, 3), (300, 3)])
@pytest.mark.parametrize(("kind", "most"), [("i4", 2**29), ("i8", 2**30)])
def test_packed_numbers_come_back(kind, most, shape, differences):
    values = np.random.default_rng(0).integers(-most, most, shape, kind)
    np.testing.assert_array_equal(unpacked(packed(values, differences=differences)), values)


def test_packed_faces_come_back():
    first, second, third = unpacked(packed_faces(CLEAN.faces)).T
    first = np.cumsum(first)
    np.testing.assert_array_equal(np.stack([first, first + second, first + third], axis=1), CLEAN.faces)


def test_numbers_in_steps_are_off_by_half_a_step_and_none_is_cut_off():
    values = np.append(np.random.default_rng(0).normal(size=5000), [np.nan, 40.0, -40.0])
    codes, start, step = in_steps(values)
    assert codes[-3] == 0 and (np.delete(codes, -3) > 0).all()
    assert step < np.abs(values[:5000]).max() / 250
    back = start + step * (codes - 1)
    assert np.nanmax(np.abs(np.where(codes > 0, back, np.nan) - values)) <= 0.5001 * step
    assert in_steps(np.full(3, np.nan)).codes.tolist() == [0, 0, 0]
    assert in_steps(np.zeros(3)).codes.tolist() == [1, 1, 1]
