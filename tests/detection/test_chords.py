"""Chords against the normals at their ends: zero error on spheres and cylinders, third order on smooth surfaces."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from shapes import cylinder, grid, noisy, torus

from cascadenorm.detection.chords import chord_noise, chord_residuals
from cascadenorm.mesh import Mesh, unit


def random_ball(count: int) -> Mesh:
    """A sphere triangulated over random points: edges of all lengths, slivers among them."""
    points = unit(np.random.default_rng(0).normal(size=(count, 3)))
    hull = ConvexHull(points)
    a, b, c = points[hull.simplices].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    faces = hull.simplices.copy()
    faces[inward] = faces[inward, ::-1]
    return Mesh(points, faces)


def test_a_sphere_has_no_error_however_it_is_triangulated():
    assert chord_residuals(random_ball(400)).max() < 1e-12


def test_a_cylinder_of_strips_has_no_error_on_either_side_of_its_creases():
    assert chord_residuals(cylinder(24)).max() < 1e-12


def test_the_error_of_a_smooth_surface_is_of_third_order():
    size, error = [], []
    for rows in (40, 80, 160):
        mesh = torus(rows, rows // 2, waves=0.1)
        size.append(mesh.mean_edge_length)
        error.append(np.sqrt(np.mean(chord_residuals(mesh) ** 2)))
    assert np.polyfit(np.log(size), np.log(error), 1)[0] > 2.7


@pytest.mark.parametrize("level", [0.02, 0.1])
def test_local_noise_is_that_of_the_vertices(level):
    plane = grid(40, 40)
    rough = noisy(plane, level)
    estimate = chord_noise(rough, chord_residuals(rough)) / plane.mean_edge_length
    inner = (np.abs(plane.vertices[:, :2] - 20) < 14).all(axis=1)
    assert estimate[inner].mean() == pytest.approx(1.2 * level, rel=0.3)
    assert estimate[inner].std() < 0.25 * level


def test_there_is_no_estimate_where_no_edge_has_two_faces():
    single = Mesh(np.eye(3), [(0, 1, 2)])
    assert np.isinf(chord_noise(single, chord_residuals(single))).all()
