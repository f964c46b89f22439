"""Vertices are moved to where their faces have the given normals, by sweeps or by least squares."""

from typing import get_args

import numpy as np
import pytest
from shapes import cube, grid, icosphere, mean_angle, noisy

import cascadenorm as cn
from cascadenorm.baselines import vertex_update
from cascadenorm.baselines.vertex_update import Weighting, least_squares_vertices, recover_vertices, side_weights
from cascadenorm.mesh import Mesh, angles_between
from cascadenorm.registry import registered


def test_with_cotangent_weights_thin_faces_come_nearer_to_their_normals():
    clean = grid(30, 30)
    clean = clean.moved(clean.vertices * (1, 0.1, 1) + np.sin(clean.vertices[:, :1] / 4) * (0, 0, 1))
    rough = noisy(clean, 0.1, seed=1)
    errors = [
        mean_angle(rough.moved(recover_vertices(rough, clean.face_normals, weighting=weighting)), clean)
        for weighting in get_args(Weighting)
    ]
    assert errors[1] < 0.8 * errors[0]


@pytest.mark.compiled
def test_errors_of_the_normals_of_elongated_faces_do_not_grow():
    sheet = grid(100, 16)
    angle, along = 2 * np.pi * sheet.vertices[:, 0] / 16, sheet.vertices[:, 1] / 50
    tube = sheet.moved(np.stack([np.cos(angle), np.sin(angle), along], axis=1))  # triangles 20 times as long as high
    turned = tube.face_normals + np.random.default_rng(0).normal(0, 0.03, tube.face_normals.shape)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    error = np.degrees(angles_between(turned, tube.face_normals).mean())
    fits = {w: tube.moved(recover_vertices(tube, turned, weighting=w)) for w in get_args(Weighting)}
    assert mean_angle(fits["uniform"], tube) > 3 * error
    assert mean_angle(fits["cotangent"], tube) < 0.7 * error


def test_with_cotangent_weights_the_squared_sines_of_the_angles_are_summed_by_area():
    mesh = noisy(grid(6, 6), 0.3)
    normals = noisy(grid(6, 6), 0.3, seed=2).face_normals
    corners = mesh.vertices[mesh.faces]
    sides = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)
    energy = (side_weights(mesh, "cotangent") * (sides * normals[:, None]).sum(axis=2) ** 2).sum(axis=1)
    np.testing.assert_allclose(energy, mesh.areas * np.sin(angles_between(normals, mesh.face_normals)) ** 2)


def test_weights_of_degenerate_faces_are_bounded():
    sheet = Mesh([[0, 0, 0], [4, 0, 0], [0, 3, 0], [2, -1e-9, 0]], [[0, 1, 2], [1, 0, 3]])
    found = side_weights(sheet, "cotangent")
    np.testing.assert_allclose(found[0], [0, 2 / 3, 3 / 8], atol=1e-15)
    np.testing.assert_allclose(found[1], [12.5, 12.5, -6.25], rtol=1e-6)
    np.testing.assert_array_equal(side_weights(sheet, "uniform"), 1 / 3)
    point = Mesh(np.zeros((3, 3)), [[0, 1, 2]])
    np.testing.assert_array_equal(side_weights(point, "cotangent"), 0)
    for weighting in get_args(Weighting):
        np.testing.assert_array_equal(recover_vertices(point, np.eye(3)[:1], weighting=weighting), 0)


def test_faces_without_area_do_not_send_vertices_away():
    """Two sheets touch at a corner, where a face without area hangs between them, with a vertex of its own."""
    sheet = grid(4, 4)
    beside = sheet.vertices * (-1, -1, 1) - (1e-14, 0, 0)
    faces = np.concatenate([sheet.faces, sheet.faces + 25, [[0, 25, 50]]])
    flat = Mesh(np.concatenate([sheet.vertices, beside, [[-0.9, 0, 0]]]), faces)
    normals = np.random.default_rng(2).normal((0, 0, 1), 0.1, flat.faces.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    moved = recover_vertices(flat, normals, weighting="cotangent")
    assert np.linalg.norm(moved - flat.vertices, axis=1).max() < 1


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


@pytest.mark.compiled
def test_true_normals_bring_the_error_near_zero_and_turn_no_face():
    for clean in (icosphere(3), cube(10)):
        rough = noisy(clean, 0.2, seed=1)
        out = rough.moved(recover_vertices(rough, clean.face_normals, sweeps=100))
        assert mean_angle(rough, clean) > 15
        assert mean_angle(out, clean) < 1.5
        assert ((out.face_normals * clean.face_normals).sum(axis=1) > 0).all()


def fitted(mesh, normals, attachment=1e-3):
    weights = side_weights(mesh, "uniform")
    return mesh.moved(least_squares_vertices(mesh, normals, weights=weights, attachment=attachment))


@pytest.mark.parametrize("clean, level", [(icosphere(3), 0.2), (cube(8), 0.1), (grid(12, 12), 0.1)])
def test_true_normals_bring_the_error_near_zero(clean, level):
    rough = noisy(clean, level, seed=1)
    error = mean_angle(fitted(rough, clean.face_normals), clean)
    assert error < 0.05 * mean_angle(rough, clean)
    assert mean_angle(fitted(rough, clean.face_normals, 1e-6), clean) < 0.2 * error


def test_the_gradient_of_the_energy_vanishes():
    clean = noisy(grid(5, 6), 0.1)
    mesh = Mesh(np.concatenate([clean.vertices, [[7.0, 7, 7]]]), clean.faces)
    rng = np.random.default_rng(0)
    normals = mesh.face_normals + 0.2 * rng.normal(size=mesh.face_normals.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    weights = rng.uniform(0.5, 2, mesh.faces.shape)
    vertices = least_squares_vertices(mesh, normals, weights=weights, attachment=0.1)
    pull, total = np.zeros_like(vertices), np.zeros(len(vertices))
    for corners, normal, opposite in zip(mesh.faces, normals, weights, strict=True):
        for side, weight in zip(((1, 2), (2, 0), (0, 1)), opposite, strict=True):
            i, j = corners[list(side)]
            force = weight * normal * (normal @ (vertices[i] - vertices[j]))
            pull[i] += force
            pull[j] -= force
            total[[i, j]] += weight
    np.testing.assert_allclose(pull + 0.1 * total[:, None] * (vertices - mesh.vertices), 0, atol=1e-12)
    assert (vertices[-1] == 7).all()


@pytest.mark.compiled
def test_many_sweeps_of_the_vertex_update_come_to_the_same_place():
    clean = icosphere(2)
    rough = noisy(clean, 0.05)
    swept = rough.moved(recover_vertices(rough, clean.face_normals, sweeps=3000))
    solved = fitted(rough, clean.face_normals, 1e-5)
    assert mean_angle(swept, clean) < 0.02 and mean_angle(solved, clean) < 0.02
    apart = np.linalg.norm(swept.vertices - solved.vertices, axis=1).mean()
    assert apart < 0.2 * np.linalg.norm(swept.vertices - rough.vertices, axis=1).mean()


def test_one_factorisation_does(monkeypatch):
    made = []

    class Counted(vertex_update.Factorisation):
        def __init__(self, matrix, positions):
            made.append(matrix.shape)
            super().__init__(matrix, positions)

    monkeypatch.setattr(vertex_update, "Factorisation", Counted)
    fitted(icosphere(2), icosphere(2).face_normals)
    assert made == [(3 * 162, 3 * 162)]


def test_huge_systems_are_solved_by_conjugate_gradients_with_the_same_result(monkeypatch):
    clean = icosphere(2)
    rough = noisy(clean, 0.2)
    direct = fitted(rough, clean.face_normals).vertices
    monkeypatch.setattr(vertex_update, "DENSE_LIMIT", 0)
    np.testing.assert_allclose(fitted(rough, clean.face_normals).vertices, direct, atol=1e-8)


FITTING = [name for name, method in registered().items() if "fit" in method.settings]


def test_all_filters_of_normals_let_vertices_be_fitted_by_either_way():
    assert [name for name, method in registered().items() if name.endswith(("-normal", "-normal-global"))] == FITTING


@pytest.mark.compiled
@pytest.mark.parametrize("name", FITTING)
def test_least_squares_denoises_with_every_filter_of_normals(name):
    clean = icosphere(3)
    rough = noisy(clean, 0.2)
    for fit in ("sweeps", "least-squares"):
        out = rough.moved(cn.denoise(rough.vertices, rough.faces, method=name, fit=fit))
        assert mean_angle(out, clean) < 0.9 * mean_angle(rough, clean)
