"""Loops of any length are closed by triangles."""

import pytest
from holed import without
from shapes import grid

from cascadenorm.geometry.holes.filling import fill_holes


def test_a_loop_beyond_the_optimal_length_is_filled_too():
    plane = grid(90, 90)
    pierced = without(plane, (abs(plane.centroids[:, :2] - 45) < 40).all(axis=1))
    filled = fill_holes(pierced, max_edges=330)
    assert filled.area == pytest.approx(8100, rel=1e-6)
    assert abs(filled.vertices[:, 2]).max() < 1e-9
