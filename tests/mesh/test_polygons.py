"""Polygons are cut into triangles."""

import numpy as np
import pytest

from cascadenorm.mesh import Mesh
from cascadenorm.mesh.polygons import Polygons, triangulate


def test_polygon_fans_do_not_fold():
    arrow = np.array([(0, 0, 0), (2, -1, 0), (1, 0, 0), (2, 1, 0)], float)  # concave at its third corner
    for turn in range(4):
        corners = np.roll(np.arange(4), turn)
        triangles, owners = triangulate(arrow, Polygons.from_rows(corners[None]))
        assert owners.tolist() == [0, 0]
        assert (Mesh(arrow, triangles).face_normals[:, 2] > 0).all()


def test_short_polygons_have_no_triangle():
    polygons = Polygons.from_counts(np.array([2, 3, 1, 4, 0]), np.array([0, 1, 0, 1, 2, 3, 0, 1, 2, 3]))
    triangles, owners = triangulate(np.eye(4)[:, :3], polygons)
    assert owners.tolist() == [1, 3, 3]
    assert triangles[0].tolist() == [0, 1, 2]


def test_polygons_that_no_corner_sees_whole_are_cut_into_ears():
    letter = np.array([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)], float)  # U
    frame = np.array([(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)], float)  # a hole
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    for flat, area in ((letter, 7), (frame, 12), (letter[::-1], 7)):
        points = np.column_stack([flat, np.zeros(len(flat))]) @ turn.T
        for first in range(len(points)):
            triangles, owners = triangulate(points, Polygons.from_rows(np.roll(np.arange(len(points)), first)[None]))
            mesh = Mesh(points, triangles)
            assert len(owners) == len(points) - 2
            assert mesh.area == pytest.approx(area)
            assert np.linalg.norm(mesh.area_vectors.sum(axis=0)) == pytest.approx(area)  # none against another


@pytest.mark.compiled
def test_a_spiral_is_cut_whole():
    """The area is that of the shoelace formula; as many comparisons as corners squared take well below a second."""
    turn = np.linspace(0, 40 * np.pi, 2000)
    arm = np.column_stack([np.cos(turn), np.sin(turn)]) * turn[:, None]
    flat = np.concatenate([arm * (1 + 1 / (1 + turn[:, None])), arm[::-1]])
    (x, y), (u, v) = flat.T, np.roll(flat, -1, axis=0).T
    triangles, _ = triangulate(np.column_stack([flat, np.zeros(len(flat))]), Polygons.from_rows(np.arange(4000)[None]))
    (a, b), (c, d), (e, f) = (flat[triangles[:, k]].T for k in range(3))
    areas = ((c - a) * (f - b) - (e - a) * (d - b)) / 2
    assert areas.min() >= -1e-9 * areas.max()
    assert areas.sum() == pytest.approx((x * v - u * y).sum() / 2)
    assert len(np.unique(np.sort(triangles, axis=1), axis=0)) == 3998


def test_of_many_concave_polygons_each_is_cut():
    letter = np.array([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)], float)
    points = np.concatenate([np.column_stack([letter + 4 * i, np.zeros(8)]) for i in range(300)])
    triangles, owners = triangulate(points, Polygons.from_rows(np.arange(len(points)).reshape(-1, 8)))
    areas = np.bincount(owners, Mesh(points, triangles).areas)
    np.testing.assert_allclose(areas, 7)


def test_a_polygon_that_crosses_itself_is_cut_somehow():
    star = np.array([(np.cos(2.4 * np.pi * i / 3), np.sin(2.4 * np.pi * i / 3), 0.0) for i in range(5)])
    for points in (star, np.full((5, 3), np.nan), np.zeros((5, 3))):
        triangles, _ = triangulate(points, Polygons.from_rows(np.arange(5)[None]))
        assert triangles.shape == (3, 3)
