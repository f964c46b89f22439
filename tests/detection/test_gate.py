"""The gate: trees as arrays, a decision for each component, and all networks in one file."""

from dataclasses import replace

import numpy as np
import pytest
from shapes import ball_of_voxels, grid, icosphere, noisy, side_by_side
from sklearn.ensemble import ExtraTreesClassifier

import cascadenorm as cn
from cascadenorm.data_gen.scanning.volumes import volume_surface
from cascadenorm.detection.gate import SMALL_SHARE, Gate, component_kinds
from cascadenorm.detection.triangulation import FIGURES
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.gated import GatedCascades, read_model
from cascadenorm.learned.methods import mesh_treatment, shipped
from cascadenorm.learned.training.gate_training import GateConfig, fitted_gate
from cascadenorm.mesh import Mesh

OPEN_SIDES = FIGURES.index("open sides")
OPEN = Gate(
    roots=np.array([0], np.int32),
    figures=np.array([OPEN_SIDES, -1, -1], np.int32),
    limits=np.zeros(3, np.float32),
    children=np.array([(1, 2), (0, 0), (0, 0)], np.int32),
    shares=np.array([0, 0.1, 0.9], np.float32),
)
"""A gate that takes open surfaces for measured ones."""


def test_trees_as_arrays_say_what_the_forest_says():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(300, len(FIGURES))).astype(np.float32)
    y = x[:, 3] + x[:, 7] * x[:, 11] > 0
    config = GateConfig(trees=20, least=2)
    gate = fitted_gate(config, x, y, np.ones(len(x)))
    forest = ExtraTreesClassifier(20, min_samples_leaf=2, max_features=0.2, random_state=0).fit(x, y)
    tested = rng.normal(size=(50, len(FIGURES))).astype(np.float32)
    expected = forest.predict_proba(tested)[:, 1]
    np.testing.assert_allclose([gate.probability(row) for row in tested], expected, atol=1e-6)


def test_each_component_is_judged_by_its_own_triangles():
    both = component_kinds(OPEN, side_by_side(grid(10, 10), icosphere(2)))
    assert both.probabilities.tolist() == pytest.approx([0.9, 0.1])
    assert both.measured.tolist() == [True, False]


def test_components_that_are_small_beside_the_mesh_are_judged_together():
    closed, sheets = icosphere(1), [Mesh(np.eye(3), [(0, 1, 2)])] * 2
    mesh = side_by_side(icosphere(4), closed, *sheets)
    assert len(closed.faces) > SMALL_SHARE * len(mesh.faces) > 2
    assert component_kinds(OPEN, mesh).measured.tolist() == [False, False, True, True]


@pytest.mark.parametrize("inside", [ball_of_voxels(9.0), np.ones((7, 8, 9), bool)])
def test_a_closed_surface_of_a_mask_is_measured_whatever_the_trees_say_unless_it_has_no_steps(inside):
    mesh = volume_surface(np.pad(inside, 2).astype(float))
    assert component_kinds(OPEN, mesh).measured.tolist() == [inside.min() == 0]


def test_vertices_without_faces_are_not_judged():
    mesh = icosphere(2)
    with_more = Mesh(np.concatenate([mesh.vertices, np.eye(3)]), mesh.faces)
    assert np.isnan(component_kinds(OPEN, with_more).probabilities[1:]).all()


@pytest.fixture(scope="module")
def gated() -> GatedCascades:
    """The networks of `auto` and of `cascade`, which differ in what they make of anything, behind the gate above."""
    auto = shipped("auto")
    return GatedCascades(auto.vertex, shipped("cascade"), OPEN, {"note": "for a test"})


def test_each_component_goes_through_its_network(gated):
    sheet, ball = noisy(grid(20, 20), 0.2), noisy(icosphere(3), 0.2)
    mesh = side_by_side(sheet, ball)
    vertices = gated.vertices(mesh)
    parts = side_by_side(sheet.moved(gated.surface.vertices(sheet)), ball.moved(gated.vertex.vertices(ball)))
    np.testing.assert_allclose(vertices, parts.vertices, atol=1e-9)
    np.testing.assert_array_equal(gated.vertices(ball), gated.vertex.vertices(ball))
    np.testing.assert_array_equal(gated.vertices(sheet), gated.surface.vertices(sheet))


def test_a_file_holds_both_networks_and_the_gate(gated, tmp_path):
    path = tmp_path / "both.safetensors"
    path.write_bytes(gated.to_bytes())
    again = read_model(path)
    assert isinstance(again, GatedCascades)
    assert again.to_bytes() == gated.to_bytes()
    assert again.card["gate"] == {"note": "for a test"}
    with pytest.raises(cn.ParameterError, match="cascadenorm-gated"):
        Cascade.load(path)


def test_strong_noise_has_its_own_later_stages(tmp_path):
    auto = shipped("auto")
    others = Cascade((auto.vertex.stages[0], *auto.surface.stages[1:]), {"note": "for strong noise"})
    gated = GatedCascades(auto.vertex, auto.surface, OPEN, {"note": "for a test"}, others)
    little, strong = noisy(icosphere(3), 0.02), noisy(icosphere(3), 0.2)
    little = little.moved(little.vertices * strong.mean_edge_length / little.mean_edge_length)
    np.testing.assert_array_equal(gated.vertices(strong), others.vertices(strong))
    np.testing.assert_array_equal(gated.vertices(little), replace(gated, strong=None).vertices(little))
    assert not np.allclose(gated.vertices(strong), gated.vertex.vertices(strong))
    both = side_by_side(little.moved(gated.vertices(little)), strong.moved(gated.vertices(strong)))
    np.testing.assert_allclose(gated.vertices(side_by_side(little, strong)), both.vertices, atol=1e-6)
    path = tmp_path / "three.safetensors"
    path.write_bytes(gated.to_bytes())
    again = read_model(path)
    assert isinstance(again, GatedCascades) and again.to_bytes() == gated.to_bytes()
    assert again.strong is not None and again.strong.begins_like(auto.vertex)
    assert again.card["strong"] == {"note": "for strong noise"}
    np.testing.assert_array_equal(again.vertices(strong), gated.vertices(strong))


def test_what_a_mesh_is_treated_as_can_be_overruled(gated, tmp_path):
    path = tmp_path / "both.safetensors"
    path.write_bytes(gated.to_bytes())
    ball = noisy(icosphere(3), 0.2)
    assert str(mesh_treatment(ball, model=path)) == "vertex noise (probability 0.90)"
    assert str(mesh_treatment(ball, model=path, treat_as="measured-surface")) == "measured surface (as set)"
    assert str(mesh_treatment(ball, model=path, treat_as="unknown")) == "unknown"
    mixed = side_by_side(ball, noisy(grid(8, 8), 0.1))
    share = f"{100 * len(ball.faces) // len(mixed.faces)}%"
    assert str(mesh_treatment(mixed, model=path)) == f"vertex noise (probability 0.90, {share} of the faces)"
    asked = cn.denoise(ball, model=path, treat_as="measured-surface").vertices
    default = cn.denoise(ball, model=path).vertices
    assert not np.allclose(asked, default)
    np.testing.assert_array_equal(cn.denoise(ball, model=path, treat_as="vertex-noise").vertices, default)
    with pytest.raises(cn.ParameterError, match="measured-surface"):
        cn.denoise(ball, model=path, treat_as="statue")


@pytest.mark.parametrize("turned", [False, True])
def test_faces_that_are_there_twice_count_once(turned):
    mesh = noisy(icosphere(3), 0.1)
    again = mesh.faces[:, ::-1] if turned else mesh.faces
    doubled = cn.denoise(mesh.vertices, np.concatenate([mesh.faces, again]))
    np.testing.assert_allclose(doubled, cn.denoise(mesh.vertices, mesh.faces), atol=1e-12)
