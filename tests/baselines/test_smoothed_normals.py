"""Vertices smoothed along given directions come to the mean height of those around, and know the shape of triangles."""

import numpy as np
import pytest
from iterated_normals import compact, iterated
from shapes import grid, icosphere, noisy

from cascadenorm.baselines.smoothed_normals import smoothed_normals
from cascadenorm.learned.descriptors import SMOOTHING_DIRECTION
from cascadenorm.mesh import Mesh, angles_between, unit

MESH = noisy(icosphere(2), 0.2)


def smoothed(mesh: Mesh, along: np.ndarray, passes: tuple[int, ...], sigma_r: float = np.inf) -> np.ndarray:
    """Normals between smoothed vertices, (m, p, 3)."""
    return np.stack([normals.copy() for normals in smoothed_normals(mesh, along, passes, sigma_r=sigma_r)], axis=1)


@pytest.mark.parametrize("sigma_r", [np.inf, 0.35])
def test_smoothed_vertices_take_the_mean_height_of_themselves_and_their_neighbours(sigma_r):
    along = iterated(MESH)[:, SMOOTHING_DIRECTION]
    found = smoothed(MESH, along, (1, 3), sigma_r)
    around = np.zeros((len(MESH.vertices), 3))
    np.add.at(around, MESH.faces.ravel(), np.repeat(MESH.areas[:, None] * along, 3, axis=0))
    directions = unit(around)
    weights = np.eye(len(directions))
    a, b = MESH.topology.edges.T
    weights[a, b] = weights[b, a] = compact(directions, sigma_r)[a, b]
    weights /= weights.sum(axis=1, keepdims=True)
    vertices = MESH.vertices
    for done in range(1, 4):
        heights = ((weights @ vertices - vertices) * directions).sum(axis=1, keepdims=True)
        vertices = vertices + heights * directions
        if done in (1, 3):
            np.testing.assert_allclose(found[:, done // 2], MESH.moved(vertices).face_normals, atol=1e-6)


def test_smoothed_vertices_know_the_shape_of_triangles_and_averaged_normals_do_not():
    """On a bent surface a face has not the normal at its middle, but that of the plane through its corners."""
    points = grid(30, 30).vertices - (15, 15, 0)
    bowl = Mesh(points + 0.02 * (points**2).sum(axis=1)[:, None] * (0, 0, 1), grid(30, 30).faces)
    averaged = iterated(bowl)[:, SMOOTHING_DIRECTION].astype(float)
    between = smoothed(bowl, averaged, (4,))[:, 0].astype(float)
    inner = np.abs(bowl.centroids[:, :2]).max(axis=1) < 5
    error = [angles_between(found[inner], bowl.face_normals[inner]).mean() for found in (between, averaged)]
    assert error[0] < 0.1 * error[1]


def test_faces_without_area_keep_their_normals_between_smoothed_vertices():
    flat = Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1, 3]])
    found = smoothed(flat, flat.face_normals, (1, 2))
    np.testing.assert_array_equal(found, [[[0, 0, 0]] * 2, [[0, 0, 1]] * 2])
