"""Figures of the triangulation have their analytic values, and depend on neither size nor pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes import cube, grid, icosphere, noisy

from cascadenorm.detection.triangulation import FIGURES, SAMPLED_FACES, triangulation_figures
from cascadenorm.mesh import Mesh


def figures(mesh: Mesh) -> dict[str, float]:
    values = triangulation_figures(mesh, np.arange(len(mesh.faces)))
    return dict(zip(FIGURES, values.tolist(), strict=True))


def test_a_regular_grid_has_valence_6_right_angles_and_no_bends():
    found = figures(grid(40, 40))
    assert found["valence 6"] == pytest.approx(6 * 39**2 / (3 * 2 * 40**2))
    assert found["smallest angle at 50%"] == pytest.approx(45)
    assert found["largest angle at 50%"] == pytest.approx(90)
    assert found["bends below 0.02°"] == found["faces inside planes"] == found["most frequent 4 shapes"] == 1
    sides = np.array([1, 1, np.sqrt(2)])
    assert found["deviation of lengths"] == pytest.approx(sides.std() / sides.mean())
    assert found["open sides"] == pytest.approx(4 * 40 / (3 * 2 * 40 * 40))


def test_the_bends_of_a_box_are_those_of_its_edges():
    found = figures(cube(1))
    assert found["bends below 0.2°"] == pytest.approx(1 / 3)
    assert found["bend at 50%"] == pytest.approx(90)
    assert found["open sides"] == found["faces inside planes"] == 0


def test_noise_leaves_no_shape_of_triangles_frequent():
    assert figures(icosphere(3))["most frequent 16 shapes"] > 0.5
    assert figures(noisy(icosphere(4), 0.2))["most frequent 16 shapes"] < 0.02


def test_a_surface_without_neighbours_counts_as_flat():
    found = figures(Mesh(np.eye(3), [(0, 1, 2)]))
    assert (found["open sides"], found["bends below 0.02°"], found["bend at 90%"]) == (1, 1, 0)
    assert found["smallest angle at 50%"] == pytest.approx(60)


def test_faces_without_area_do_not_count_for_bends():
    flat = grid(6, 6)
    vertices = flat.vertices.copy()
    vertices[8] = vertices[9]
    assert figures(flat.moved(vertices))["bend at 90%"] == 0


@pytest.mark.parametrize("seed", range(3))
def test_size_pose_and_order_do_not_matter(seed):
    rng, mesh = np.random.default_rng(seed), noisy(icosphere(3), 0.1)
    turned = 37.0 * mesh.vertices @ Rotation.random(random_state=seed).as_matrix().T + rng.normal(size=3)
    places = rng.permutation(len(turned))
    shuffled = np.empty_like(turned)
    shuffled[places] = turned
    other = Mesh(shuffled, rng.permutation(places[mesh.faces]))
    for name, value in figures(mesh).items():
        assert figures(other)[name] == pytest.approx(value, abs=1e-6), name


def test_a_sample_of_a_large_mesh_has_nearly_the_same_figures():
    mesh = noisy(icosphere(6), 0.1)
    assert len(mesh.faces) > 3 * SAMPLED_FACES
    parts = np.array_split(np.random.default_rng(0).permutation(len(mesh.faces)), 5)
    whole = triangulation_figures(mesh, np.arange(len(mesh.faces)))
    means = np.mean([triangulation_figures(mesh, part) for part in parts], axis=0)
    np.testing.assert_allclose(whole, means, rtol=0.05, atol=0.02)
