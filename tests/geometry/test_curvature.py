"""Mean curvature is that of spheres, planes and the formula."""

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

from cascadenorm.geometry.curvature import mean_curvature, mixed_areas
from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.geometry.volume import closed_parts, volumes
from cascadenorm.mesh import Mesh, limit_threads


@pytest.mark.parametrize("radius", [0.01, 1.0, 30.0])
def test_a_sphere_has_one_over_its_radius_everywhere(radius):
    sphere = icosphere(4)
    np.testing.assert_allclose(mean_curvature(sphere.moved(radius * sphere.vertices)), 1 / radius, rtol=0.02)


def test_a_sphere_seen_from_inside_is_curved_the_other_way():
    sphere = icosphere(3)
    inward = Mesh(sphere.vertices, sphere.faces[:, ::-1])
    np.testing.assert_allclose(mean_curvature(inward), -mean_curvature(sphere))


def test_mixed_areas_are_the_area_in_all():
    rough = noisy(icosphere(3), 0.4)
    assert mixed_areas(rough).sum() == pytest.approx(rough.area, rel=1e-12)
    assert (mixed_areas(rough) > 0).all()


def test_the_curvature_is_that_of_the_cotangent_laplacian_and_its_areas_those_of_obtuse_triangles_too():
    """Meyer et al. 2003, in plain numpy."""
    rough = noisy(icosphere(2), 0.4)
    a, b, c = (rough.vertices[rough.faces[:, k]] for k in range(3))
    squares = np.stack([np.square(u - v).sum(axis=1) for u, v in ((b, c), (c, a), (a, b))], axis=1)
    cosines = squares.sum(axis=1, keepdims=True) - 2 * squares
    weighted = squares * cosines / (4 * rough.areas[:, None])
    shares = (weighted.sum(axis=1, keepdims=True) - weighted) / 8
    obtuse = (cosines < 0).any(axis=1)
    shares[obtuse] = np.where(cosines < 0, 0.5, 0.25)[obtuse] * rough.areas[obtuse, None]
    areas = np.bincount(rough.faces.ravel(), shares.ravel())
    assert obtuse.any() and not obtuse.all()
    np.testing.assert_allclose(mixed_areas(rough), areas, rtol=1e-12)
    flow = cotangent_laplacian(rough).stiffness @ rough.vertices
    curvature = (flow * rough.vertex_normals).sum(axis=1) / (2 * areas)
    np.testing.assert_allclose(mean_curvature(rough), curvature, rtol=1e-9, atol=1e-9)


def test_curvature_and_volume_do_not_depend_on_the_number_of_threads():
    rough = noisy(icosphere(4), 0.2)
    found = []
    for threads in (1, 3):
        with limit_threads(threads):
            mesh = Mesh(rough.vertices, rough.faces)
            found.append((mean_curvature(mesh).tobytes(), volumes(mesh, closed_parts(mesh)).tobytes()))
    assert found[0] == found[1]
    assert volumes(rough, closed_parts(rough)) == pytest.approx([rough.volume], rel=1e-12)


def test_a_plane_is_not_curved_and_its_boundary_has_no_curvature():
    plane = grid(4, 5)
    x, y, _ = plane.vertices.T
    border = (x == 0) | (x == 5) | (y == 0) | (y == 4)
    curvature = mean_curvature(plane)
    np.testing.assert_array_equal(np.isnan(curvature), border)
    np.testing.assert_allclose(curvature[~border], 0, atol=1e-12)


def test_a_cube_is_curved_along_its_edges_alone():
    box = cube(6)
    on_edge = (np.abs(box.vertices) == 1).sum(axis=1) > 1
    curvature = mean_curvature(box)
    np.testing.assert_allclose(curvature[~on_edge], 0, atol=1e-12)
    assert (curvature[on_edge] > 0.1).all()


def test_vertices_without_a_face_have_no_curvature():
    sphere = icosphere(2)
    more = Mesh(np.vstack([sphere.vertices, [[9, 9, 9]]]), sphere.faces)
    curvature = mean_curvature(more)
    assert np.isnan(curvature[-1])
    np.testing.assert_allclose(curvature[:-1], mean_curvature(sphere))
