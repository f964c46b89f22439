"""Spikes on noisy surfaces are found and removed; cones, clean shapes and plain noise have none."""

import numpy as np
import pytest
from shapes import cube, cylinder, grid, icosphere, mean_angle, noisy

import cascadenorm as cn
from cascadenorm.detection.spikes import impulsive, noise_spikes, outlier_offsets, without_outliers, without_spikes
from cascadenorm.mesh import Mesh


def spiked(mesh: Mesh, count: int, height: float, *, seed: int = 0) -> tuple[Mesh, list[int]]:
    """Raise or sink some vertices, no two of them neighbours, along the normals, `height` mean edge lengths far."""
    rng = np.random.default_rng(seed)
    chosen: list[int] = []
    for vertex in rng.permutation(np.flatnonzero(~mesh.topology.boundary_vertices)).tolist():
        if len(chosen) < count and not set(chosen) & set(mesh.topology.vertex_neighbors.row(vertex).tolist()):
            chosen.append(vertex)
    vertices = mesh.vertices.copy()
    sizes = height * mesh.mean_edge_length * rng.choice([-1, 1], count)
    vertices[chosen] += sizes[:, None] * mesh.vertex_normals[chosen]
    return mesh.moved(vertices), chosen


@pytest.mark.parametrize("height", [2.0, 5.0, 20.0])
@pytest.mark.parametrize("seed", range(3))
def test_single_vertices_far_off_are_found_and_no_others(height, seed):
    rough = noisy(icosphere(4), 0.05, seed=seed)
    mesh, chosen = spiked(rough, 12, height, seed=seed)
    assert np.flatnonzero(noise_spikes(mesh)).tolist() == sorted(chosen)
    left = np.linalg.norm(without_spikes(mesh).vertices - rough.vertices, axis=1) / rough.mean_edge_length
    assert left.max() < 0.6


@pytest.mark.parametrize(
    "mesh", [cube(6), cylinder(40), icosphere(4), noisy(icosphere(4), 0.15), noisy(grid(30, 30), 0.15)]
)
def test_shapes_and_plain_noise_have_no_spikes(mesh):
    assert not noise_spikes(mesh).any()
    assert without_spikes(mesh) is mesh


def test_neighbouring_spikes_are_removed_one_after_the_other():
    rough = noisy(icosphere(4), 0.05)
    a, b = rough.topology.edges[1000]
    vertices = rough.vertices.copy()
    vertices[a] *= 2.0
    vertices[b] *= 1.3
    left = without_spikes(rough.moved(vertices)).vertices - rough.vertices
    assert np.linalg.norm(left, axis=1).max() < rough.mean_edge_length


def test_a_spike_on_a_surface_without_noise_is_shape():
    mesh = spiked(grid(20, 20), 3, 4.0)[0]
    assert without_spikes(mesh) is mesh


@pytest.mark.parametrize("height", [0.2, 0.5, 3.0])
@pytest.mark.parametrize("smooth", [icosphere(4), icosphere(4).moved(icosphere(4).vertices * (1, 1.5, 2))])
def test_outliers_on_a_smooth_surface_return_to_it(smooth, height):
    mesh, chosen = spiked(smooth, 3, height)
    assert np.flatnonzero(outlier_offsets(mesh).any(axis=1)).tolist() == sorted(chosen)
    left = np.linalg.norm(without_outliers(mesh).vertices - smooth.vertices, axis=1)
    assert left.max() < 0.1 * smooth.mean_edge_length


@pytest.mark.parametrize(
    "mesh", [cube(6), cylinder(40), icosphere(4), grid(30, 30), noisy(icosphere(4), 0.15), noisy(cube(10), 0.05)]
)
def test_shapes_and_plain_noise_have_no_outliers(mesh):
    assert without_outliers(mesh) is mesh


def test_small_components_have_neither_spikes_nor_outliers():
    rough = noisy(icosphere(4), 0.05)
    corners = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]) + 5.0
    faces = np.array([(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]) + len(rough.vertices)
    both = Mesh(np.concatenate([rough.vertices, corners]), np.concatenate([rough.faces, faces]))
    assert without_outliers(both) is both


def test_noise_is_impulsive_where_many_vertices_are_outliers():
    one, few = spiked(icosphere(4), 20, 0.5)[0], spiked(icosphere(4), 5, 0.5)[0]
    both = Mesh(
        np.concatenate([one.vertices, few.vertices + 5.0]), np.concatenate([one.faces, few.faces + len(one.vertices)])
    )
    found = impulsive(both, without_outliers(both))
    np.testing.assert_array_equal(found, np.arange(len(found)) < len(one.vertices))


def test_auto_removes_impulsive_noise_from_a_smooth_surface():
    smooth, rng = icosphere(4), np.random.default_rng(0)
    sizes = (
        0.5
        * smooth.mean_edge_length
        * (rng.random(len(smooth.vertices)) < 0.03)
        * rng.normal(size=len(smooth.vertices))
    )
    mesh = smooth.moved(smooth.vertices + sizes[:, None] * smooth.vertex_normals)
    assert mean_angle(mesh.moved(cn.denoise(mesh).vertices), smooth) < 0.3 * mean_angle(mesh, smooth)


def test_the_tip_of_a_cone_on_a_rough_plate_is_shape():
    angle = 2 * np.pi * np.arange(24) / 24
    rings = [np.stack([r * np.cos(angle), r * np.sin(angle), np.zeros(24)], axis=1) for r in np.arange(1.0, 8.0, 0.4)]
    vertices = np.concatenate([[(0, 0, 6)], *rings])
    faces = [(0, 1 + k, 1 + (k + 1) % 24) for k in range(24)]
    for ring in range(len(rings) - 1):
        a = 1 + 24 * ring + np.arange(24)
        b = 1 + 24 * ring + np.roll(np.arange(24), -1)
        faces += [*zip(a, a + 24, b, strict=True), *zip(b, a + 24, b + 24, strict=True)]
    vertices[25:] += np.random.default_rng(0).normal(scale=0.03, size=(len(vertices) - 25, 3))
    assert not noise_spikes(Mesh(vertices, faces))[0]


def test_auto_removes_spikes():
    true = icosphere(4)
    mesh, _ = spiked(noisy(true, 0.05), 30, 6.0)
    denoised = mesh.moved(cn.denoise(mesh.vertices, mesh.faces))
    assert mean_angle(mesh, true) > 6
    assert mean_angle(denoised, true) < 2
