from typing import get_args

import numpy as np
import pytest
from shapes import cube, grid, icosphere, mean_angle, noisy

from cascadenorm.baselines.vertex_update import Weighting, face_weights, recover_vertices
from cascadenorm.mesh import Mesh


def test_fitted_by_angles_thin_faces_come_nearer_to_their_normals():
    clean = grid(30, 30)
    clean = clean.moved(clean.vertices * (1, 0.1, 1) + np.sin(clean.vertices[:, :1] / 4) * (0, 0, 1))
    rough = noisy(clean, 0.1, seed=1)
    errors = [
        mean_angle(rough.moved(recover_vertices(rough, clean.face_normals, weighting=weighting)), clean)
        for weighting in get_args(Weighting)
    ]
    assert errors[1] < 0.8 * errors[0]


def test_a_face_pulls_by_its_height_but_not_without_end():
    sheet = Mesh([[0, 0, 0], [4, 0, 0], [1, 3, 0], [2, -1e-9, 0]], [[0, 1, 2], [1, 0, 3]])
    np.testing.assert_array_equal(sheet.longest_edges, [np.sqrt(18), 4])
    np.testing.assert_allclose(sheet.heights, [12 / np.sqrt(18), 1e-9])
    np.testing.assert_allclose(face_weights(sheet, "inverse-height"), [sheet.mean_edge_length / sheet.heights[0], 20])
    np.testing.assert_array_equal(face_weights(sheet, "uniform"), 1)
    point = Mesh(np.zeros((3, 3)), [[0, 1, 2]])
    np.testing.assert_array_equal(face_weights(point, "inverse-height"), 1)


@pytest.mark.parametrize("sweeps", [1, 3])
def test_with_foldovers_ignored_the_update_is_the_published_sum(sweeps):
    """x_i += (1/N_i) Σ n_f <n_f, c_f - x_i>, vertex by vertex in the order of the groups (Sun et al. 2007)."""
    rough, normals = noisy(cube(4), 0.8, seed=2), cube(4).face_normals
    topology, expected = rough.topology, rough.vertices.copy()
    for _ in range(sweeps):
        for i in topology.vertex_colors.indices:
            n = normals[topology.vertex_faces.row(i)]
            to_centroids = expected[rough.faces[topology.vertex_faces.row(i)]].mean(axis=1) - expected[i]
            expected[i] += ((n * to_centroids).sum(axis=1, keepdims=True) * n).mean(axis=0)
    found = recover_vertices(rough, normals, sweeps=sweeps, foldovers="ignore")
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert np.abs(recover_vertices(rough, normals, sweeps=sweeps) - expected).max() > 1e-3  # folds are in the way


def test_true_normals_bring_the_error_near_zero_and_turn_no_face():
    for clean in (icosphere(3), cube(10)):
        rough = noisy(clean, 0.2, seed=1)
        out = rough.moved(recover_vertices(rough, clean.face_normals, sweeps=100))
        assert mean_angle(rough, clean) > 15
        assert mean_angle(out, clean) < 1.5
        assert ((out.face_normals * clean.face_normals).sum(axis=1) > 0).all()
