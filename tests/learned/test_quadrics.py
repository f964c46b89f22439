"""Quadrics have the normals of surfaces of second order, up to the boundary, and average noise."""

import numpy as np
import pytest
from shapes import grid, icosphere, noisy

from cascadenorm.learned.surface_filter import quadric_normals
from cascadenorm.mesh import Mesh, Vectors, unit


def bent(curvature: float) -> tuple[Mesh, Vectors]:
    """Return a sheet z = curvature / 2 (x² - xy) with its true normals at the centroids of its faces, (m, 3)."""
    flat = grid(20, 20)
    x, y = flat.vertices[:, 0] - 10, flat.vertices[:, 1] - 10
    mesh = flat.moved(np.stack([x, y, 0.5 * curvature * (x * x - x * y)], axis=1))
    u, v, _ = mesh.centroids.T
    return mesh, unit(np.stack([-curvature * (u - 0.5 * v), 0.5 * curvature * u, np.ones_like(u)], axis=1))


def angles(first: Vectors, second: Vectors) -> Vectors:
    return np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", first, second), -1, 1)))


@pytest.mark.parametrize("curvature", [0.0, 0.02])
def test_normals_of_a_surface_of_second_order_are_right_up_to_the_boundary(curvature):
    mesh, true = bent(curvature)
    every = np.arange(len(mesh.faces))
    assert angles(quadric_normals(mesh, mesh.face_normals, every), true).max() < 0.2


def test_noise_is_averaged_without_flattening_the_surface():
    mesh, true = bent(0.02)
    rough = noisy(mesh, 0.1)
    edge = np.flatnonzero(mesh.topology.boundary_vertices[mesh.faces].any(axis=1))
    fitted = quadric_normals(rough, mesh.face_normals, edge)
    assert angles(fitted, true[edge]).mean() < 0.5 * angles(rough.face_normals[edge], true[edge]).mean()


def test_few_or_no_faces_keep_what_they_have():
    few = icosphere(0)
    every = np.arange(20)
    np.testing.assert_array_equal(quadric_normals(few, few.face_normals, every), few.face_normals)
    assert quadric_normals(few, few.face_normals, every[:0]).shape == (0, 3)


def test_faces_without_area_have_no_normal_and_no_influence():
    flat = grid(20, 20)
    vertices = flat.vertices.copy()
    vertices[30] = vertices[31]
    mesh = flat.moved(vertices)
    fitted = quadric_normals(mesh, mesh.face_normals, np.arange(len(mesh.faces)))
    assert (mesh.areas == 0).sum() == 2
    np.testing.assert_allclose(fitted, mesh.face_normals, atol=1e-12)


def test_the_other_side_of_an_edge_has_no_influence():
    """The fold of a sheet through 90° keeps the plane on either side."""
    flat = grid(20, 20)
    x, y, _ = flat.vertices.T
    fold = flat.moved(np.stack([np.minimum(x, 10), y, np.maximum(x - 10, 0)], axis=1))
    fitted = quadric_normals(fold, fold.face_normals, np.arange(len(fold.faces)))
    assert angles(fitted, fold.face_normals).max() < 1e-3
