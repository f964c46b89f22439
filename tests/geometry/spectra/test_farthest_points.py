"""Samples are as far apart as they can be, by distances near the true ones."""

import numpy as np
import pytest
from reference import shortest_paths
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.geometry.spectra.farthest_points import farthest_points, spread_samples
from cascadenorm.mesh import Mesh


def on_sphere(mesh, source):
    """Distances along the unit sphere, in which the mesh is inscribed."""
    return np.arccos(np.clip(mesh.vertices @ mesh.vertices[source], -1, 1))


def on_plane(mesh, source):
    return np.linalg.norm(mesh.vertices - mesh.vertices[source], axis=1)


KNOWN = [(icosphere(4), on_sphere), (grid(25, 20), on_plane)]


@pytest.mark.parametrize(("mesh", "distance"), KNOWN)
@pytest.mark.parametrize("count", [10, 40])
def test_the_covering_radius_is_at_most_the_separation_and_near_that_of_a_hexagonal_packing(mesh, distance, count):
    samples = farthest_points(mesh, count, first=5)
    assert samples[0] == 5 and len(set(samples)) == count
    truth = np.array([distance(mesh, sample) for sample in samples])
    radius = truth.min(axis=0).max()
    assert radius <= 1.03 * (truth[:, samples] + np.where(np.eye(count), np.inf, 0)).min()  # 1 for exact distances
    assert radius < 1.6 * np.sqrt(2 * mesh.area / (3 * np.sqrt(3) * count))


def test_from_one_sample_distances_on_the_plane_are_exact():
    plane = grid(30, 20)
    _, distances = spread_samples(plane, 1, first=100)
    np.testing.assert_allclose(distances, np.linalg.norm(plane.vertices - plane.vertices[100], axis=1), atol=1e-12)


@pytest.mark.parametrize(("mesh", "distance"), KNOWN)
@pytest.mark.parametrize("count", [1, 4, 30])
def test_distances_are_near_the_true_ones(mesh, distance, count):
    samples, distances = spread_samples(mesh, count, first=0)
    truth = np.min([distance(mesh, sample) for sample in samples], axis=0)
    assert abs(distances - truth).mean() < 0.01 * truth.mean()
    assert abs(distances.max() / truth.max() - 1) < 0.03


@pytest.mark.parametrize("mesh", [noisy(icosphere(0), 0.5), noisy(grid(4, 5), 0.3), noisy(cube(2), 0.2)])
def test_distances_are_near_the_shortest_of_all_unfoldings(mesh):
    for source, truth in enumerate(shortest_paths(mesh)):
        _, distances = spread_samples(mesh, 1, first=source)
        assert abs(distances - truth).mean() < 0.03 * truth.mean()


def test_each_component_gets_a_sample_before_any_gets_its_second_and_lone_vertices_none():
    ball = icosphere(1)
    vertices = np.concatenate([ball.vertices, [[9, 9, 9]], ball.vertices + 4, ball.vertices - 4])
    faces = np.concatenate([ball.faces, ball.faces + 43, ball.faces + 85])
    samples = cn.farthest_points((vertices, faces), 3)
    assert {np.searchsorted([43, 85], sample, side="right") for sample in samples} == {0, 1, 2}
    everything = cn.farthest_points((vertices, faces), 126)
    assert sorted(everything) == [i for i in range(127) if i != 42]
    with pytest.raises(cn.ParameterError, match="count is 127; it must be from 1 to 126"):
        cn.farthest_points((vertices, faces), 127)
    with pytest.raises(cn.ParameterError, match="first is 42"):
        cn.farthest_points((vertices, faces), 3, first=42)
    with pytest.raises(cn.ParameterError, match=r"first is 1\.5; it must be a whole number"):
        cn.farthest_points((vertices, faces), 3, first=1.5)


def test_no_two_samples_lie_in_one_place():
    ball = icosphere(2)
    faces = np.concatenate([ball.faces, [(0, 162, 1)]])
    twice = np.concatenate([ball.vertices, ball.vertices[:1]])
    assert sorted(cn.farthest_points((twice, faces), 163)) == list(range(162))


def test_samples_do_not_depend_on_scale():
    mesh = noisy(icosphere(3), 0.2)
    expected = farthest_points(mesh, 40)
    for factor in (2.0**-600, 2.0**500):
        np.testing.assert_array_equal(cn.farthest_points((factor * mesh.vertices, mesh.faces), 40), expected)


def test_faces_that_repeat_a_vertex_do_not_count():
    mesh = noisy(icosphere(2), 0.2)
    with_lines = Mesh(mesh.vertices, np.concatenate([mesh.faces, [(0, 100, 100)]]))
    expected = farthest_points(mesh, 20)
    np.testing.assert_array_equal(farthest_points(with_lines, 20), expected)
