"""Parts as CAD kernels tessellate them: closed, within their tolerance, the same for the same seed."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.meshing.cad_tessellation import MAKERS, cad_part
from cascadenorm.data_gen.meshing.half_edges import is_manifold
from cascadenorm.data_gen.meshing.outlines import circle, rounded, sketch
from cascadenorm.data_gen.meshing.polygon_triangulation import triangulated


def signed_area(points: np.ndarray) -> float:
    x, y = points.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


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


@given(st.floats(1e-4, 0.1), st.floats(0.1, 10))
def test_chords_of_a_circle_stay_within_the_tolerance(tolerance, radius):
    points = circle(radius, tolerance=tolerance).points
    middles = 0.5 * (points + np.roll(points, -1, axis=0))
    assert (radius - np.linalg.norm(middles, axis=1)).max() <= tolerance * (1 + 1e-9)


def test_offsets_of_a_rounded_polygon_are_parallel_to_it():
    """Area and length of a parallel curve of lines and arcs: Steiner's formula, but for the chords."""
    corners = [(0, 0), (4, 0), (4, 3), (2, 3), (2, 1), (0, 1)]
    loop = rounded(corners, 0.3, tolerance=1e-6)
    length = float(np.linalg.norm(np.roll(loop.points, -1, axis=0) - loop.points, axis=1).sum())
    for d in (-0.1, 0.2):
        expected = signed_area(loop.points) + d * length + np.pi * d**2
        assert signed_area(loop.offset(d)) == pytest.approx(expected, rel=1e-4)
    square = rounded(corners, 0.0, tolerance=1.0)
    np.testing.assert_allclose(square.offset(0.5)[[0, 1]], [(-0.5, -0.5), (4.5, -0.5)], atol=1e-12)


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("seed", range(3))
def test_parts_are_closed_and_converge_with_the_tolerance(make, seed):
    volumes = []
    for tolerance in (1e-2, 1e-3):
        try:
            mesh = make(tolerance, np.random.default_rng(seed))
        except UnfitShapeError:
            return
        assert (mesh.topology.edge_faces.counts == 2).all() and is_manifold(mesh)
        assert (mesh.topology.balance == 0).all(), "consistently oriented"
        volumes.append(mesh.volume)
    assert volumes[1] > 0 and volumes[0] == pytest.approx(volumes[1], rel=0.15)


def test_a_seed_and_a_number_of_faces_decide_a_part():
    def part() -> object:
        rng = np.random.default_rng(5)
        while True:
            try:
                return cad_part(faces=2000, rng=rng)
            except UnfitShapeError:
                continue

    first, again = part(), part()
    assert first.vertices.tobytes() == again.vertices.tobytes() and 1400 <= len(first.faces) <= 2800
    assert np.linalg.norm(first.vertices, axis=1).max() == pytest.approx(1, rel=0.01)
