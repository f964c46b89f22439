"""Samples are drawn from the faces whose true normal is known."""

import numpy as np
from shapes import icosphere

from cascadenorm.learned.training.samples import Sample


def test_at_most_so_many_faces_with_a_known_normal_are_drawn():
    ball = icosphere(2)
    known = np.arange(1, len(ball.faces), 2)
    normals = np.zeros_like(ball.face_normals)
    normals[known] = ball.face_normals[known]
    few, all_of_them = (Sample.drawn(0, ball.vertices, ball.faces, normals, count=n, seed=1) for n in (50, 1000))
    assert len(np.unique(few.rows)) == 50 and np.isin(few.rows, known).all()
    np.testing.assert_allclose(few.truth, ball.face_normals[few.rows], atol=1e-7)
    np.testing.assert_array_equal(all_of_them.rows, known)
