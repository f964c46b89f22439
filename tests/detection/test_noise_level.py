"""The noise of a mesh is estimated from the mesh alone, as a whole and place by place."""

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy, side_by_side

from cascadenorm.api.inspection import inspect, noise_level
from cascadenorm.data_gen.families import SHAPE_FAMILIES
from cascadenorm.detection.noise_level import component_noise, local_noise

SHAPES = {
    "sphere": lambda: icosphere(4),
    "cube": lambda: cube(20),
    "sheet": lambda: grid(30, 30),
    "creature": lambda: SHAPE_FAMILIES["creature"].make(faces=5000, rng=np.random.default_rng(0)).clean,
    "assembly": lambda: SHAPE_FAMILIES["assembly"].make(faces=5000, rng=np.random.default_rng(0)).clean,
}


@pytest.mark.parametrize("name", SHAPES)
def test_noise_is_estimated_within_a_quarter(name):
    shape = SHAPES[name]()
    assert noise_level(shape) < 0.02
    for level in (0.05, 0.1, 0.2, 0.35, 0.5):
        rough = noisy(shape, level, seed=1)
        estimate = noise_level(rough) * rough.mean_edge_length / shape.mean_edge_length
        assert estimate == pytest.approx(level, rel=0.25)


def test_noise_on_a_plane_is_right_within_its_scatter():
    sheet = grid(100, 100)
    heights = np.zeros_like(sheet.vertices)
    heights[:, 2] = np.random.default_rng(0).normal(scale=0.01, size=len(heights))
    rough = sheet.moved(sheet.vertices + heights)
    assert noise_level(rough) * rough.mean_edge_length == pytest.approx(0.01, rel=0.03)


def test_noise_needs_edges_away_from_the_boundary():
    assert noise_level(grid(3, 3)) is None
    assert inspect([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).noise is None


def test_noise_is_that_of_the_mesh_where_a_few_vertices_lie_at_one_place():
    mesh = noisy(icosphere(4), 0.2)
    vertices = mesh.vertices.copy()
    vertices[mesh.topology.vertex_neighbors.row(100)] = vertices[100]
    assert noise_level(mesh.moved(vertices)) == pytest.approx(noise_level(mesh), rel=0.05)


def test_local_noise_is_as_strong_as_the_noise_there():
    ball = icosphere(5)
    level = np.where(ball.vertices[:, 2] > 0, 0.05, 0.3)
    heights = np.random.default_rng(0).normal(size=len(level)) * level * ball.mean_edge_length
    local = local_noise(ball.moved(ball.vertices * (1 + heights[:, None])))
    for above, strength in ((ball.vertices[:, 2] > 0.2, 0.05), (ball.vertices[:, 2] < -0.2, 0.3)):
        assert np.sqrt(np.square(local[above]).mean()) == pytest.approx(strength, rel=0.15)


def test_local_noise_is_none_of_a_clean_plane_and_unknown_at_its_boundary():
    local = local_noise(grid(6, 6))
    known = ~np.isnan(local)
    np.testing.assert_allclose(local[known], 0, atol=1e-12)
    assert known.reshape(7, 7)[3, 3] and not known.reshape(7, 7)[0, 6]
    assert np.isnan(local_noise(grid(1, 1))).all()


def test_the_noise_of_a_component_is_that_of_the_component_by_itself():
    parts = noisy(icosphere(4), 0.02), icosphere(4)
    mesh, alone = side_by_side(*parts), [noise_level(part) * part.mean_edge_length for part in parts]
    np.testing.assert_allclose(component_noise(mesh, np.array([True, True])), alone, rtol=1e-9, atol=1e-9)
    assert np.isnan(component_noise(mesh, np.array([True, False]))[1])
