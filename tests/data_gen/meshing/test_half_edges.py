"""A mesh comes back from its half-edges, which know what lies on creases."""

import numpy as np
from shapes import cube, icosphere

from cascadenorm.data_gen.meshing.half_edges import CORNER, CREASE, SMOOTH, half_edges_of, mesh_of


def test_a_mesh_comes_back_from_its_half_edges():
    ball = icosphere(2)
    np.testing.assert_array_equal(mesh_of(half_edges_of(ball)).corners, ball.corners)


def test_vertices_on_edges_of_a_cube_lie_on_creases_that_end_at_its_corners():
    box = cube(4)
    first, second = box.face_normals[box.topology.face_pairs.T]
    kind = half_edges_of(box, creases=(first * second).sum(axis=1) < 0.5).kind[: len(box.vertices)]
    sides = (np.abs(box.vertices) > 1 - 1e-9).sum(axis=1)
    np.testing.assert_array_equal(kind, np.array([SMOOTH, CREASE, CORNER])[sides - 1])
