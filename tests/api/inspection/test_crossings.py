"""Faces that cross others are found, and faces that only touch are not."""

import numpy as np
import pytest
from shapes import icosphere, together

from cascadenorm.api.inspection.crossings import crossing_faces
from cascadenorm.mesh import Mesh


@pytest.mark.parametrize("shift", [(1.0, 0, 0), (0.3, 0.5, 0.7)])
def test_balls_that_overlap_cross_along_a_curve(shift):
    two = together(icosphere(3), icosphere(3).moved(icosphere(3).vertices + shift))
    crossing = crossing_faces(two)
    heights = np.linalg.norm(two.corners - shift, axis=2) * np.linalg.norm(two.corners, axis=2)
    near = (heights.min(axis=1) < 1) & (heights.max(axis=1) > 1)  # on the curve both distances are 1
    assert crossing[:1280].sum() > 30 and crossing[1280:].sum() > 30
    assert not crossing[np.abs(heights - 1).min(axis=1) > 0.4].any()
    assert near[crossing].mean() > 0.9


def test_triangles_cross_or_touch():
    flat = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    cases = {
        "through the middle": ([[0.2, 0.2, -1], [0.3, 0.2, 1], [0.3, 0.3, 1]], True),
        "a side through a side": ([[0.5, 0, -1], [0.5, 0, 1], [0.5, -1, 0]], True),
        "a corner on the face": ([[0.2, 0.2, 0], [0.3, 0.2, 1], [0.3, 0.3, 1]], False),
        "in one plane": ([[0.1, 0.1, 0], [0.9, 0.2, 0], [0.2, 0.9, 0]], False),
        "beside": ([[2, 0, -1], [2, 0, 1], [2, 1, 0]], False),
        "a shared corner only": ([[0, 0, 0], [-1, 0, 1], [0, -1, 1]], False),
        "a shared corner and through": ([[0, 0, 0], [0.5, 0.4, -1], [0.5, 0.4, 1]], True),
    }
    for name, (other, cross) in cases.items():
        mesh = Mesh(np.array(flat + other, float), [[0, 1, 2], [3, 4, 5]])
        for scale in (1.0, 1e-6):
            found = crossing_faces(mesh.moved(mesh.vertices * scale))
            assert found.tolist() == [cross, cross], name
