"""The flow keeps cylinders and edges, which mean curvature flow shrinks and rounds."""

import numpy as np
import pytest
from flows import cylinder, distance_to_cube
from shapes import cube, icosphere, noisy

from cascadenorm.baselines.anisotropic_diffusion import diffused_vertex_normals
from cascadenorm.baselines.diffusion import mean_curvature_flow
from cascadenorm.baselines.prescribed_mean_curvature import area_gradient, crease_weights, prescribed_mean_curvature
from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.mesh import Mesh, unit

MESH = noisy(icosphere(2), 0.15)


def test_with_weights_one_it_is_the_gradient_of_the_area():
    expected = cotangent_laplacian(MESH).stiffness @ MESH.vertices
    np.testing.assert_allclose(area_gradient(MESH, np.ones(len(MESH.topology.edges))), expected, atol=1e-12)


def test_weights_are_one_where_it_is_smooth_small_at_creases_and_zero_at_boundaries():
    sphere = icosphere(4)
    assert (crease_weights(sphere, sphere.vertices, threshold=0.2) == 1).all()
    box = cube(8)
    both = box.topology.edge_faces.indices.reshape(-1, 2)
    crease = np.linalg.norm(box.face_normals[both[:, 0]] - box.face_normals[both[:, 1]], axis=1) > 1
    weights = crease_weights(box, diffused_vertex_normals(box, 0), threshold=0.2)
    assert weights[crease].max() < 0.15
    normals = np.array([[1, 0, 0], [1, 1, 0], [1, 1, 0], [0, 1, 0]]) / [[1], [2**0.5], [2**0.5], [1]]
    two = Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], [(0, 1, 2), (1, 3, 2)])
    middles = [unit(normals[face].sum(axis=0)) for face in two.faces]
    turn = np.linalg.norm(middles[1] - middles[0])
    weights = crease_weights(two, normals, threshold=0.2)
    assert sorted(weights)[:4] == [0, 0, 0, 0]
    assert weights.max() == pytest.approx(0.2**2 / (10 * (turn - 0.2) ** 2 + 0.2**2))


def test_cylinder_keeps_its_radius_where_mean_curvature_flow_shrinks_it():
    clean, radius = cylinder(40, 30)
    rough = noisy(clean, 0.1)
    middle = (clean.vertices[:, 2] > 5) & (clean.vertices[:, 2] < 25)

    def radii(vertices):
        return np.linalg.norm(vertices[middle, :2], axis=1)

    settings = {"step": 0.5, "iterations": 10}
    kept = radii(prescribed_mean_curvature(rough, **settings))
    shrunk = radii(mean_curvature_flow(rough, **settings))
    assert kept.mean() == pytest.approx(radius, rel=0.005)
    assert shrunk.mean() < 0.95 * radius
    assert kept.std() < 0.4 * radii(rough.vertices).std()


def test_noise_free_cylinder_stays_and_so_does_its_boundary():
    clean, _ = cylinder(40, 10)
    moved = prescribed_mean_curvature(clean, iterations=10)
    assert np.linalg.norm(moved - clean.vertices, axis=1).max() < 0.1 * clean.mean_edge_length


def test_noisy_cube_keeps_its_edges():
    clean = cube(16)
    rough = noisy(clean, 0.15)
    on_edges = (abs(clean.vertices) > 1 - 1e-9).sum(axis=1) > 1
    settings = {"step": 0.5, "iterations": 5}
    kept = distance_to_cube(prescribed_mean_curvature(rough, **settings))
    rounded = distance_to_cube(mean_curvature_flow(rough, **settings))
    assert kept[on_edges].mean() < 0.5 * rounded[on_edges].mean()
    assert kept[~on_edges].mean() < 0.5 * distance_to_cube(rough.vertices)[~on_edges].mean()


def test_vertices_outside_the_region_stay():
    region = MESH.vertices[:, 0] > 0
    moved = prescribed_mean_curvature(MESH, region=region)
    assert ((moved == MESH.vertices).all(axis=1) == ~region).all()
