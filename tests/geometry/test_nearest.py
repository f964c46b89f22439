"""The nearest point of a surface is that of a search through all triangles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import cube, grid, icosphere

from cascadenorm.geometry.nearest import SurfaceTree
from cascadenorm.mesh import Mesh, limit_threads


def distance_to_triangle(point, a, b, c) -> float:
    """Twin: the least of |p - (a + s(b - a) + t(c - a))| over the triangle, by its interior and its three sides."""
    candidates = []
    edges = np.stack([b - a, c - a], axis=1)
    st, *_ = np.linalg.lstsq(edges, point - a, rcond=None)
    if st.min() >= 0 and st.sum() <= 1:
        candidates.append(a + edges @ st)
    for start, end in ((a, b), (b, c), (c, a)):
        along = end - start
        share = np.clip((point - start) @ along / max(along @ along, 1e-300), 0, 1)
        candidates.append(start + share * along)
    return min(np.linalg.norm(point - candidate) for candidate in candidates)


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.floats(0, 2))
@settings(max_examples=40)
def test_equals_the_search_through_all_triangles(seed, count, spread):
    rng = np.random.default_rng(seed)
    corners = (
        rng.normal(size=(count, 1, 3)) * spread
        + rng.normal(size=(count, 3, 3)) * rng.choice([0.01, 1, 5], count)[:, None, None]
    )
    corners[::7, 2] = corners[::7, 1]  # segments
    corners[::11] = corners[::11, :1]  # points
    mesh = Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
    points = np.concatenate([rng.normal(size=(10, 3)) * 3, corners[:5, 0], mesh.centroids[:5]])
    found = SurfaceTree(mesh).nearest(points)
    expected = [[distance_to_triangle(point, *triangle) for triangle in corners] for point in points]
    np.testing.assert_allclose(found.distances, np.min(expected, axis=1), atol=1e-7)
    reached = np.take_along_axis(np.array(expected), found.faces[:, None], axis=1)[:, 0]
    np.testing.assert_allclose(reached, found.distances, atol=1e-7)


def test_distances_to_a_cube_are_those_of_its_formula():
    points = np.random.default_rng(0).uniform(-3, 3, size=(500, 3))
    outside = np.linalg.norm(np.maximum(np.abs(points) - 1, 0), axis=1)
    inside = np.maximum(1 - np.abs(points).max(axis=1), 0)
    np.testing.assert_allclose(SurfaceTree(cube(3)).nearest(points).distances, outside + inside, atol=1e-12)


def test_points_of_the_surface_are_at_no_distance_of_their_own_face():
    mesh = icosphere(3)
    found = SurfaceTree(mesh).nearest(mesh.centroids)
    assert found.distances.max() < 1e-15
    np.testing.assert_array_equal(found.faces, np.arange(len(mesh.faces)))


def test_among_equally_near_faces_the_first_counts():
    sheet = grid(3, 3)
    found = SurfaceTree(sheet).nearest(sheet.vertices + np.array([0, 0, 2]))
    first = [np.flatnonzero((sheet.faces == i).any(axis=1))[0] for i in range(len(sheet.vertices))]
    np.testing.assert_array_equal(found.faces, first)


@pytest.mark.compiled
@pytest.mark.parametrize("threads", [2, 3])
def test_same_bytes_for_any_number_of_threads(threads):
    mesh, points = icosphere(4), np.random.default_rng(1).normal(size=(3000, 3))
    with limit_threads(1):
        one = SurfaceTree(mesh).nearest(points)
    with limit_threads(threads):
        many = SurfaceTree(mesh).nearest(points)
    assert one.distances.tobytes() == many.distances.tobytes()
    assert one.faces.tobytes() == many.faces.tobytes()
