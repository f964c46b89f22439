"""Triangles cover a polygon with holes once, or loops that cannot be covered are refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import signed_area

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.outlines import circle, sketch
from cascadenorm.data_gen.meshing.polygon_triangulation import triangulated


def plane_with_holes(seed: int) -> tuple[np.ndarray, list[np.ndarray]]:
    rng = np.random.default_rng(seed)
    outline = sketch(4.0, tolerance=0.02, rng=rng).points
    loops, points = [np.arange(len(outline))], [outline]
    for center in rng.permutation([(x, y) for x in (-1.2, 0, 1.2) for y in (-1.2, 0, 1.2)])[: rng.integers(0, 6)]:
        hole = circle(rng.uniform(0.02, 0.3), tolerance=0.01).points[::-1] + 0.15 * center
        loops.append(np.arange(len(hole)) + sum(map(len, points)))
        points.append(hole)
    return np.concatenate(points), loops


@pytest.mark.parametrize("delaunay", [False, True])
@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_triangles_cover_a_polygon_with_holes_once(delaunay, seed):
    points, loops = plane_with_holes(seed)
    try:
        triangles = triangulated(points, loops, delaunay=delaunay)
    except UnfitShapeError:  # holes of this test may touch
        return
    assert len(triangles) == len(points) + 2 * (len(loops) - 1) - 2
    areas = np.array([signed_area(points[triangle]) for triangle in triangles])
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(sum(signed_area(points[loop]) for loop in loops), rel=1e-9)


def test_delaunay_triangles_have_empty_circles_where_nothing_is_in_the_way():
    rng = np.random.default_rng(3)
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float)
    points = np.concatenate([square, rng.uniform(0.05, 0.95, (60, 2))])
    triangles = triangulated(points, [np.arange(4)], inner=range(4, 64))
    assert len(triangles) == 2 + 2 * 60
    for triangle in triangles:
        a, b, c = points[triangle]
        center = np.linalg.solve(2 * np.array([b - a, c - a]), [b @ b - a @ a, c @ c - a @ a])
        assert (np.linalg.norm(points - center, axis=1) > np.linalg.norm(a - center) - 1e-9).all()


def test_loops_that_cross_are_refused():
    with pytest.raises(UnfitShapeError):
        triangulated(np.array([(0, 0), (1, 1), (1, 0), (0, 1)], float), [np.arange(4)])
    with pytest.raises(UnfitShapeError, match="not inside"):
        triangulated(np.array([(0, 0), (1, 0), (0, 1), (2, 2)], float), [np.arange(3)], inner=[3])
