"""Rotations are rotations, and a slight bend changes next to nothing."""

import numpy as np
import pytest
from distance_fields import EXACT, points

from cascadenorm.data_gen.shapes import fields, placement


def test_bending_keeps_the_middle_and_tends_to_nothing():
    a, at = EXACT["box"], points(8)
    np.testing.assert_allclose(placement.bent(a, curvature=1e-5)(at), a(at), atol=1e-4)
    middle = at * [0, 1, 1]
    np.testing.assert_allclose(placement.bent(a, curvature=0.5)(middle), a(middle), atol=1e-12)


def test_rotations_are_rotations():
    turn = placement.random_rotation(rng=np.random.default_rng(0))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1)
    turned = placement.aligned(fields.cylinder(radius=0.1, half_height=2.0), [0, 3, 0])
    assert turned(np.array([[0.0, 1.0, 0.0]]))[0] == pytest.approx(-0.1)
