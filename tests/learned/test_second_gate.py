"""The second gate recognises errors that the vertex network takes for shape, and leaves clean meshes alone."""

from dataclasses import replace

import numpy as np
import pytest
from gates import OPEN, gate_above
from shapes import grid, icosphere, noisy, side_by_side

import cascadenorm as cn
from cascadenorm.data_gen import DatasetConfig, pair
from cascadenorm.learned import second_gate
from cascadenorm.learned.gated import GatedCascades, read_model
from cascadenorm.learned.methods import mesh_treatment, shipped
from cascadenorm.learned.second_gate import first_normals, removed_figures, unnoticed_figures
from cascadenorm.learned.stage_normals import stage_normals
from cascadenorm.mesh import Mesh, angles_between

AUTO = shipped("auto")
VERTEX, SURFACE = AUTO.vertex.stages[0], AUTO.surface.stages[0]
MEAN_ANGLE = 6


def every(mesh: Mesh) -> np.ndarray:
    return np.arange(len(mesh.faces))


def test_where_the_vertex_network_finds_noise_nothing_is_measured():
    mesh = side_by_side(noisy(icosphere(3), 0.2), icosphere(3))
    noise, none = unnoticed_figures(VERTEX, SURFACE, mesh, np.split(every(mesh), 2))
    assert noise is None
    assert none is not None and none[MEAN_ANGLE] < 1


def test_figures_do_not_depend_on_size_and_direction():
    mesh = noisy(icosphere(3), 0.1)
    normals = stage_normals(SURFACE, mesh, mesh)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    turned = mesh.moved(1e-3 * mesh.vertices @ turn.T + 5)
    np.testing.assert_allclose(removed_figures(turned, normals @ turn.T), removed_figures(mesh, normals), rtol=1e-4)


def test_only_what_is_removed_from_noise_averages_out():
    mesh = noisy(icosphere(4), 0.1)
    alike = removed_figures(mesh, mesh.face_normals + np.array([0.0, 0.0, 0.1]))
    assert alike[:6] == pytest.approx(np.ones(6))
    noise = removed_figures(mesh, icosphere(4).face_normals)
    assert noise[0] < 0.5 and noise[5] < 0.05


@pytest.mark.parametrize("vertices", [np.eye(3), np.zeros((3, 3))])
def test_a_single_face_has_finite_figures(vertices):
    mesh = Mesh(vertices, [(0, 1, 2)])
    assert np.isfinite(removed_figures(mesh, mesh.face_normals)).all()


def test_of_a_large_surface_a_sample_is_evaluated(monkeypatch):
    evaluated = []

    def counted(mesh: Mesh, normals: np.ndarray) -> np.ndarray:
        evaluated.append(len(mesh.faces))
        return removed_figures(mesh, normals)

    monkeypatch.setattr(second_gate, "removed_figures", counted)
    monkeypatch.setattr(second_gate, "SAMPLED_FACES", 1000)
    monkeypatch.setattr(second_gate, "SMALLEST_SAMPLE", 1000)
    mesh = grid(60, 60)
    (figures,) = unnoticed_figures(VERTEX, SURFACE, mesh, [every(mesh)])
    assert figures is not None and figures[MEAN_ANGLE] < 1
    assert 900 <= evaluated[0] <= 1000


def test_normals_of_small_meshes_are_computed_once():
    mesh = noisy(icosphere(2), 0.1)
    assert first_normals(VERTEX, mesh) is first_normals(VERTEX, mesh)
    assert not np.array_equal(first_normals(VERTEX, mesh), first_normals(SURFACE, mesh))


def test_the_second_gate_decides_for_each_component_and_is_kept_in_the_file(tmp_path):
    model = GatedCascades(AUTO.vertex, AUTO.surface, OPEN, {}, None, gate_above(MEAN_ANGLE, 0.0))
    mesh = side_by_side(icosphere(3), noisy(icosphere(3), 0.2), grid(10, 10))
    assert model.component_kinds(mesh).measured.tolist() == [True, False, True]
    assert model.component_kinds(mesh, "vertex-noise").measured.tolist() == [False, False, False]
    path = tmp_path / "gated.safetensors"
    path.write_bytes(model.to_bytes())
    again = read_model(path)
    assert isinstance(again, GatedCascades) and again.to_bytes() == model.to_bytes()
    assert again.component_kinds(mesh).measured.tolist() == [True, False, True]


def test_a_scan_with_other_triangles_is_denoised():
    config = DatasetConfig(
        seed=42, families=("retriangulated_scan",), min_faces=3000, max_faces=6000, count=100, min_level=0.3
    )
    made = pair(config, 5)

    def angle(mesh: Mesh) -> float:
        return float(np.degrees(angles_between(mesh.face_normals, made.normals)).mean())

    assert mesh_treatment(made.noisy).treatment == "measured-surface"
    first_gate_only = replace(AUTO, second_gate=None)
    assert angle(cn.denoise(made.noisy, model=first_gate_only)) > 0.95 * angle(made.noisy) > 5
    assert angle(cn.denoise(made.noisy)) < 0.6 * angle(made.noisy)
