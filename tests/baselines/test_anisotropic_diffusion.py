"""Anisotropic diffusion is the cotangent flow where a surface is smooth, and hardly crosses its edges."""

import numpy as np
import pytest
from flows import distance_to_cube
from shapes import cube, grid, icosphere, noisy

from cascadenorm.baselines.anisotropic_diffusion import (
    anisotropic_diffusion,
    anisotropic_laplacian,
    diffused_vertex_normals,
)
from cascadenorm.baselines.diffusion import mean_curvature_flow
from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.mesh import Mesh, unit

MESH = noisy(icosphere(2), 0.2)


def test_without_a_threshold_it_is_the_cotangent_laplacian():
    ours = anisotropic_laplacian(MESH, diffused_vertex_normals(MESH, 0), threshold=1e12)
    cotangent = cotangent_laplacian(MESH)
    assert abs(ours.stiffness - cotangent.stiffness).max() < 1e-10
    np.testing.assert_allclose(ours.mass, cotangent.mass, rtol=1e-10)
    settings = {"step": 0.3, "iterations": 3}
    expected = mean_curvature_flow(MESH, **settings)
    np.testing.assert_allclose(anisotropic_diffusion(MESH, threshold=1e12, **settings), expected, atol=1e-8)


def test_on_a_cylinder_diffusion_is_full_along_and_falls_with_the_curvature_around():
    radius, plane = 8.0, grid(20, 20)
    angle, z = plane.vertices[:, 0] / radius, plane.vertices[:, 1]
    normals = np.stack([np.cos(angle), np.sin(angle), 0 * z], axis=1)
    patch = Mesh(normals * (radius, radius, 1) + z[:, None] * (0, 0, 1), plane.faces)
    threshold = 0.1
    stiffness = anisotropic_laplacian(patch, normals, threshold=threshold).stiffness
    share = 1 / (1 + (patch.mean_edge_length / radius / threshold) ** 2)  # about 0.31
    assert z @ stiffness @ z == pytest.approx(patch.area, rel=1e-3)
    assert (radius * angle) @ stiffness @ (radius * angle) == pytest.approx(share * patch.area, rel=5e-3)


def test_stiffness_is_semidefinite_and_does_not_see_constants():
    stiffness = anisotropic_laplacian(MESH, diffused_vertex_normals(MESH, 1), threshold=0.1).stiffness.toarray()
    assert (stiffness == stiffness.T).all()
    np.testing.assert_allclose(stiffness.sum(axis=1), 0, atol=1e-12)
    values = np.linalg.eigvalsh(stiffness)
    assert values[0] > -1e-12 and values[1] > 1e-3


def test_degenerate_faces_give_finite_weights():
    mesh = Mesh([(0, 0, 0), (2, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 0)], [(0, 1, 2), (0, 1, 3), (0, 3, 4), (0, 0, 1)])
    stiffness = anisotropic_laplacian(mesh, unit(mesh.vertices), threshold=0.1).stiffness
    assert np.isfinite(stiffness.data).all()
    assert np.isfinite(anisotropic_diffusion(mesh)).all()


def test_noisy_cube_keeps_its_edges_where_isotropic_flow_rounds_them():
    clean = cube(16)
    rough = noisy(clean, 0.15)
    on_edges = (abs(clean.vertices) > 1 - 1e-9).sum(axis=1) > 1
    settings = {"step": 0.3, "iterations": 8}
    kept = distance_to_cube(anisotropic_diffusion(rough, **settings))
    rounded = distance_to_cube(mean_curvature_flow(rough, **settings))
    assert kept[on_edges].mean() < 0.4 * rounded[on_edges].mean()
    assert kept[~on_edges].mean() < 0.5 * distance_to_cube(rough.vertices)[~on_edges].mean()


def test_vertices_outside_the_region_stay():
    region = MESH.vertices[:, 0] > 0
    moved = anisotropic_diffusion(MESH, region=region)
    assert ((moved == MESH.vertices).all(axis=1) == ~region).all()
