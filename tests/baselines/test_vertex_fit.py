import numpy as np
import pytest
from shapes import cube, grid, icosphere, mean_angle, noisy

import cascadenorm as cn
from cascadenorm.baselines import vertex_fit
from cascadenorm.baselines.vertex_fit import least_squares_vertices
from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.mesh import Mesh
from cascadenorm.registry import registered


def fitted(mesh, normals, attachment=1e-3):
    weights = np.ones(len(mesh.faces))
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
    weights = rng.uniform(0.5, 2, len(mesh.faces))
    vertices = least_squares_vertices(mesh, normals, weights=weights, attachment=0.1)
    pull, total = np.zeros_like(vertices), np.zeros(len(vertices))
    for corners, normal, weight in zip(mesh.faces, normals, weights, strict=True):
        center = vertices[corners].mean(axis=0)
        for i in corners:
            pull[i] += weight * normal * (normal @ (vertices[i] - center))
            total[i] += weight
    np.testing.assert_allclose(pull + 0.1 * total[:, None] * (vertices - mesh.vertices), 0, atol=1e-12)
    assert (vertices[-1] == 7).all()


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

    class Counted(vertex_fit.Factorisation):
        def __init__(self, matrix, positions):
            made.append(matrix.shape)
            super().__init__(matrix, positions)

    monkeypatch.setattr(vertex_fit, "Factorisation", Counted)
    fitted(icosphere(2), icosphere(2).face_normals)
    assert made == [(3 * 162, 3 * 162)]


def test_huge_systems_are_solved_by_conjugate_gradients_with_the_same_result(monkeypatch):
    clean = icosphere(2)
    rough = noisy(clean, 0.2)
    direct = fitted(rough, clean.face_normals).vertices
    monkeypatch.setattr(vertex_fit, "DENSE_LIMIT", 0)
    np.testing.assert_allclose(fitted(rough, clean.face_normals).vertices, direct, atol=1e-8)


FITTING = [name for name, method in registered().items() if "fit" in method.settings]


def test_all_filters_of_normals_let_vertices_be_fitted_by_either_way():
    assert [name for name, method in registered().items() if name.endswith(("-normal", "-normal-global"))] == FITTING


@pytest.mark.parametrize("name", FITTING)
def test_least_squares_denoises_with_every_filter_of_normals(name):
    clean = icosphere(3)
    rough = noisy(clean, 0.2)
    for fit in ("sweeps", "least-squares"):
        out = rough.moved(cn.denoise(rough.vertices, rough.faces, method=name, fit=fit))
        assert mean_angle(out, clean) < 0.9 * mean_angle(rough, clean)
