"""Noise has the level and the direction that it claims."""

import numpy as np
import pytest
from shapes import icosphere

from cascadenorm.data_gen import displacements
from cascadenorm.data_gen.noise.noise import relief


def test_vertex_normals_of_the_sphere_are_radial(ball):
    radial = ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", ball.vertex_normals, radial).min() > 0.99


@pytest.mark.parametrize("level", [0.05, 0.3])
def test_gaussian_noise_along_normals_has_its_level_and_moves_along_normals_only(ball, level):
    moved = displacements(ball, "normal", level=level, rng=np.random.default_rng(1)) / ball.mean_edge_length
    along = np.einsum("ij,ij->i", moved, ball.vertex_normals)
    np.testing.assert_allclose(moved, along[:, None] * ball.vertex_normals, atol=1e-14)
    count = len(ball.vertices)
    assert along.std() == pytest.approx(level, rel=5 / np.sqrt(2 * count))
    assert abs(along.mean()) < 5 * level / np.sqrt(count)


@pytest.mark.parametrize("kind", ["gaussian", "uniform"])
def test_noise_in_all_directions_has_its_level_in_each_coordinate(ball, kind):
    moved = displacements(ball, kind, level=0.2, rng=np.random.default_rng(2)) / ball.mean_edge_length
    np.testing.assert_allclose(moved.std(axis=0), 0.2, rtol=5 / np.sqrt(2 * len(moved)))
    correlation = np.corrcoef(moved.T) - np.eye(3)
    assert np.abs(correlation).max() < 5 / np.sqrt(len(moved))
    if kind == "uniform":
        assert np.abs(moved).max() <= 0.2 * np.sqrt(3)


def test_impulsive_noise_leaves_some_vertices_alone_and_hits_the_rest_at_its_level(ball):
    moved = displacements(ball, "impulsive", level=0.4, rng=np.random.default_rng(3)) / ball.mean_edge_length
    hit = np.abs(moved).max(axis=1) > 0
    assert 0.03 < hit.mean() < 0.65
    along = np.einsum("ij,ij->i", moved, ball.vertex_normals)[hit]
    assert along.std() == pytest.approx(0.4, rel=6 / np.sqrt(2 * hit.sum()))


def test_varying_noise_has_its_level_over_all_and_others_in_places(ball):
    moved = displacements(ball, "varying", level=0.3, rng=np.random.default_rng(4)) / ball.mean_edge_length
    size = np.linalg.norm(moved, axis=1)
    assert np.sqrt(np.mean(size**2)) == pytest.approx(0.3, rel=0.15)
    by_place = [size[(ball.vertices @ axis) > 0.8].mean() for axis in np.concatenate([np.eye(3), -np.eye(3)])]
    assert max(by_place) > 1.5 * min(by_place)


@pytest.mark.parametrize("seed", range(8))
def test_relief_is_smooth_at_the_scale_of_the_edges_and_along_the_normals(seed):
    mesh = icosphere(5)
    moves = relief(mesh, rng=np.random.default_rng(seed))
    along = np.einsum("ij,ij->i", moves, mesh.vertex_normals)
    np.testing.assert_allclose(moves, along[:, None] * mesh.vertex_normals, atol=1e-14)
    a, b = mesh.topology.edges.T
    assert np.corrcoef(along[a], along[b])[0, 1] > 0.4
    assert 0.005 < along.std() / mesh.mean_edge_length < 2.5


def test_no_noise_is_the_identity(ball):
    rng = np.random.default_rng(5)
    np.testing.assert_array_equal(displacements(ball, "none", level=0.5, rng=rng), 0)
    for kind in ("normal", "gaussian", "uniform", "impulsive", "varying", "mixed", "sensor"):
        np.testing.assert_array_equal(displacements(ball, kind, level=0.0, rng=rng), 0)


def test_noise_scales_with_the_mesh(ball):
    for kind in ("normal", "gaussian", "impulsive", "varying", "mixed"):
        one = displacements(ball, kind, level=0.2, rng=np.random.default_rng(6))
        large = displacements(ball.moved(1000 * ball.vertices), kind, level=0.2, rng=np.random.default_rng(6))
        np.testing.assert_allclose(large, 1000 * one, rtol=1e-9, atol=1e-9)


def test_unknown_kinds_and_negative_levels_are_refused(ball):
    rng = np.random.default_rng(7)
    with pytest.raises(ValueError, match=r"'salt'.*impulsive"):
        displacements(ball, "salt", level=0.1, rng=rng)
    with pytest.raises(ValueError, match=r"-0\.1"):
        displacements(ball, "normal", level=-0.1, rng=rng)


@pytest.mark.parametrize("seed", range(6))
def test_correlated_noise_has_its_deviation_and_is_alike_in_neighbours(seed):
    mesh = icosphere(5)
    rng = np.random.default_rng(seed)
    moves = displacements(mesh, "correlated", level=0.3, rng=rng) / mesh.mean_edge_length
    along = np.einsum("ij,ij->i", moves, mesh.vertex_normals)
    size = np.sqrt(np.mean(np.sum(moves**2, axis=1)))
    assert 0.25 < size < 0.3 * np.sqrt(3) * 1.25
    a, b = mesh.topology.edges.T
    assert np.corrcoef(along[a], along[b])[0, 1] > 0.2
