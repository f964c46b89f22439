"""What holds for every filter of face normals."""

from typing import get_args

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

from cascadenorm.api import methods
from cascadenorm.mesh import Mesh
from cascadenorm.recover import Misfit, misfit_weights, recover_vertices

KEEP_EDGES = {  # parameters that tell the sides of a cube apart
    "bilateral-normal": {"sigma_r": 0.1},
    "bilateral-normal-global": {"sigma_r": 0.1},
    "guided-normal": {"sigma_r": 0.1},
    "median-normal": {},
    "random-walk-normal": {"sigma_r": 0.1},
    "tv-normal": {"fidelity": 1e6},
    "unilateral-normal": {},
}
FILTERS = {**KEEP_EDGES, "mean-normal": {}}
CUT_CORNERS = ("guided-normal", "median-normal")
"""A triangle that cuts a corner off has no flat patch to be guided by, and is outvoted by those across the edges."""
name = pytest.mark.parametrize("name", FILTERS)


def mean_angle(mesh: Mesh, true: Mesh) -> float:
    return np.degrees(np.arccos(np.clip((mesh.normals * true.normals).sum(axis=1), -1, 1))).mean()


def bent_sheet(steps: int) -> Mesh:
    """A square sheet with a right-angled bend in the middle."""
    sheet = grid(steps, steps)
    x, y, _ = sheet.vertices.T
    return sheet.moved(np.stack([np.minimum(x, steps // 2), y, np.maximum(x - steps // 2, 0)], axis=1))


@name
def test_a_plane_stays(name):
    np.testing.assert_allclose(methods()[name](grid(8, 8)), grid(8, 8).vertices, atol=1e-12)


@pytest.mark.parametrize("name", KEEP_EDGES)
def test_an_edge_and_a_noise_free_cube_stay(name):
    for mesh in (bent_sheet(8),) if name in CUT_CORNERS else (bent_sheet(8), cube(5)):
        out = methods()[name](mesh, **KEEP_EDGES[name])
        np.testing.assert_allclose(out, mesh.vertices, atol=1e-7 * mesh.mean_edge_length)


@name
def test_noise_goes(name):
    for clean in (icosphere(3),) if name == "mean-normal" else (cube(10), icosphere(3)):
        rough = noisy(clean, 0.12, seed=4)
        smooth = rough.moved(methods()[name](rough))
        assert mean_angle(smooth, clean) < 0.55 * mean_angle(rough, clean)


@name
def test_in_plane_noise_of_a_sheet_stays_in_its_plane(name):
    sheet = grid(8, 8)
    jitter = np.random.default_rng(0).uniform(-0.2, 0.2, sheet.vertices.shape) * (1, 1, 0)
    out = methods()[name](sheet.moved(sheet.vertices + jitter))
    np.testing.assert_allclose(out[:, 2], 0, atol=1e-12)


def test_fitted_by_angles_thin_faces_come_nearer_to_their_normals():
    clean = grid(30, 30)
    clean = clean.moved(clean.vertices * (1, 0.1, 1) + np.sin(clean.vertices[:, :1] / 4) * (0, 0, 1))
    rough = noisy(clean, 0.1, seed=1)
    errors = [
        mean_angle(rough.moved(recover_vertices(rough, clean.normals, misfit=misfit)), clean)
        for misfit in get_args(Misfit)
    ]
    assert errors[1] < 0.8 * errors[0]


def test_a_face_pulls_by_its_height_at_most_ten_times_as_a_usual_one():
    sheet = Mesh([[0, 0, 0], [4, 0, 0], [1, 3, 0], [2, -1e-9, 0]], [[0, 1, 2], [1, 0, 3]])
    np.testing.assert_array_equal(sheet.longest_edges, [np.sqrt(18), 4])
    np.testing.assert_allclose(sheet.heights, [12 / np.sqrt(18), 1e-9])
    np.testing.assert_allclose(misfit_weights(sheet, "angles"), [sheet.mean_edge_length / sheet.heights[0], 10])
    np.testing.assert_array_equal(misfit_weights(sheet, "heights"), 1)
    point = Mesh(np.zeros((3, 3)), [[0, 1, 2]])
    np.testing.assert_array_equal(misfit_weights(point, "angles"), 1)


def test_true_normals_bring_the_error_near_zero_and_turn_no_face():
    for clean in (icosphere(3), cube(10)):
        rough = noisy(clean, 0.2, seed=1)
        out = rough.moved(recover_vertices(rough, clean.normals, sweeps=100))
        assert mean_angle(rough, clean) > 15
        assert mean_angle(out, clean) < 1.5
        assert ((out.normals * clean.normals).sum(axis=1) > 0).all()
