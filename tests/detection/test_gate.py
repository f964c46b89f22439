"""The gate judges each component by the shares of its trees."""

import numpy as np
import pytest
from gates import OPEN
from shapes import ball_of_voxels, grid, icosphere, side_by_side
from sklearn.ensemble import ExtraTreesClassifier

from cascadenorm.data_gen.scanning.volumes import volume_surface
from cascadenorm.detection.gate import SMALL_SHARE, Gate, component_kinds
from cascadenorm.detection.triangulation import FIGURES
from cascadenorm.learned.training.gate_training import GateConfig, fitted_gate
from cascadenorm.mesh import Mesh


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


def test_a_gate_is_read_from_older_weights_that_list_both_children():
    older = {
        "roots": np.array([0], np.int32),
        "figures": np.array([3, -1, 5, -1, -1], np.int32),
        "limits": np.array([1.0, 0, 2.0, 0, 0], np.float32),
        "children": np.array([(1, 2), (0, 0), (3, 4), (0, 0), (0, 0)], np.int32),
        "shares": np.array([0, 0.1, 0, 0.4, 0.9], np.float32),
    }
    gate = Gate.from_arrays(older)
    assert gate.probability(np.array([0, 0, 0, 0.5, 0, 3.0])) == pytest.approx(0.1)
    assert gate.probability(np.array([0, 0, 0, 1.5, 0, 1.0])) == pytest.approx(0.4)
    assert gate.probability(np.array([0, 0, 0, 1.5, 0, 3.0])) == pytest.approx(0.9)
    again = Gate.from_arrays(gate.arrays())
    assert all(np.array_equal(array, again.arrays()[name]) for name, array in gate.arrays().items())


@pytest.mark.parametrize(("second", "measured"), [(0.6, [True, True]), (0.5, [True, False])])
def test_a_second_opinion_is_asked_only_for_what_the_gate_does_not_recognise(second, measured):
    mesh, asked = side_by_side(grid(10, 10), icosphere(2)), []

    def opinion(mesh, groups):
        asked.extend(len(faces) for faces in groups)
        return np.full(len(groups), second)

    kinds = component_kinds(OPEN, mesh, opinion)
    assert asked == [len(icosphere(2).faces)]
    assert kinds.measured.tolist() == measured
    assert kinds.probabilities.tolist() == pytest.approx([0.9, second if measured[1] else 0.1])


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
