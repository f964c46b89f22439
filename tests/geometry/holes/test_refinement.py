"""Patches are as dense as the mesh around them."""

import numpy as np
import pytest
from holed import without_cap

from cascadenorm.geometry.holes.filling import fill_holes
from cascadenorm.mesh import Mesh


def test_patch_is_as_dense_as_the_mesh_around_it():
    open_sphere = without_cap(4, 0.87)
    filled = fill_holes(open_sphere)
    patch = Mesh(filled.vertices, filled.faces[len(open_sphere.faces) :])
    assert patch.mean_edge_length == pytest.approx(open_sphere.mean_edge_length, rel=0.15)
    sides = np.roll(patch.corners, -1, axis=1) - patch.corners
    lengths = np.linalg.norm(sides, axis=2)
    cosines = -(sides * np.roll(sides, 1, axis=1)).sum(axis=2) / (lengths * np.roll(lengths, 1, axis=1))
    assert np.degrees(np.arccos(cosines)).min() > 15
