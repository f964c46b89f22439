"""Outlines keep within their tolerance, and their offsets are parallel to them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapes import signed_area

from cascadenorm.data_gen.meshing.outlines import circle, rounded


@given(st.floats(1e-4, 0.1), st.floats(0.1, 10))
def test_chords_of_a_circle_stay_within_the_tolerance(tolerance, radius):
    points = circle(radius, tolerance=tolerance).points
    middles = 0.5 * (points + np.roll(points, -1, axis=0))
    assert (radius - np.linalg.norm(middles, axis=1)).max() <= tolerance * (1 + 1e-9)


def test_offsets_of_a_rounded_polygon_are_parallel_to_it():
    """Area and length of a parallel curve of lines and arcs: Steiner's formula, but for the chords."""
    corners = [(0, 0), (4, 0), (4, 3), (2, 3), (2, 1), (0, 1)]
    loop = rounded(corners, 0.3, tolerance=1e-6)
    length = float(np.linalg.norm(np.roll(loop.points, -1, axis=0) - loop.points, axis=1).sum())
    for d in (-0.1, 0.2):
        expected = signed_area(loop.points) + d * length + np.pi * d**2
        assert signed_area(loop.offset(d)) == pytest.approx(expected, rel=1e-4)
    square = rounded(corners, 0.0, tolerance=1.0)
    np.testing.assert_allclose(square.offset(0.5)[[0, 1]], [(-0.5, -0.5), (4.5, -0.5)], atol=1e-12)
