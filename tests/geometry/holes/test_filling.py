"""Holes are filled as the surface around them goes on, and outer boundaries stay."""

import numpy as np
import pytest
from holed import without, without_cap
from shapes import cube, grid, icosphere, noisy

from cascadenorm.errors import ParameterError
from cascadenorm.geometry.holes.filling import boundary_loops, fill_holes, filled
from cascadenorm.mesh import Mesh


def assert_closed_and_oriented(mesh):
    sides = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    keys = sides[:, 0] * len(mesh.vertices) + sides[:, 1]
    assert len(np.unique(keys)) == len(keys)
    assert set(map(tuple, sides)) == set(map(tuple, sides[:, ::-1]))


@pytest.mark.parametrize("level", [3, 4])
def test_sphere_comes_back_from_a_thin_plate_within_one_percent(level):
    open_sphere = without_cap(level, 0.87)
    filled = fill_holes(open_sphere, order=2)
    new = np.linalg.norm(filled.vertices[len(open_sphere.vertices) :], axis=1)
    assert new == pytest.approx(1, abs=0.01)
    assert filled.volume == pytest.approx(icosphere(level).volume, rel=2e-3)
    assert_closed_and_oriented(filled)


def test_membrane_is_flatter_than_a_thin_plate():
    open_sphere = without_cap(3, 0.87)
    flat = fill_holes(open_sphere, order=1).vertices[len(open_sphere.vertices) :]
    assert np.linalg.norm(flat, axis=1).min() < 0.95


def test_what_was_there_keeps_positions_and_numbers():
    rough = noisy(without_cap(3, 0.8), 0.1)
    filled = fill_holes(rough)
    assert (filled.vertices[: len(rough.vertices)] == rough.vertices).all()
    assert (filled.faces[: len(rough.faces)] == rough.faces).all()
    assert len(filled.faces) > len(rough.faces)


def test_flat_hole_is_filled_flat_and_its_area_is_what_was_missing():
    plane = grid(12, 12)
    middle = (abs(plane.centroids[:, :2] - 6) < 3).all(axis=1)
    pierced = without(plane, middle)
    for order in (1, 2, 3):
        filled = fill_holes(pierced, order=order, max_edges=30)  # the outer boundary has 48
        assert abs(filled.vertices[:, 2]).max() < 1e-12
        assert filled.area == pytest.approx(144, rel=1e-9)
        assert (filled.face_normals[:, 2] > 0.999).all()


def test_several_holes_and_holes_that_touch_at_a_vertex():
    box = cube(6)
    corner = box.topology.vertex_faces.row(20)
    far = np.argmax(np.linalg.norm(box.vertices - box.vertices[20], axis=1))
    faces = np.zeros(len(box.faces), bool)
    faces[corner] = faces[box.topology.vertex_faces.row(far)] = True
    pierced = without(box, faces)
    assert [len(loop) for loop in boundary_loops(pierced)] == [
        len(box.topology.vertex_neighbors.row(i)) for i in (20, far)
    ]
    assert_closed_and_oriented(fill_holes(pierced))

    plane = grid(6, 6)
    touching = without(plane, np.isin(np.arange(72), [7, 36 + 7, 14, 36 + 14]))  # two squares with one corner in common
    loops = boundary_loops(touching)
    assert sorted(len(loop) for loop in loops) == [4, 4, 24]
    filled = fill_holes(touching, max_edges=8, order=1)
    assert filled.area == pytest.approx(36)


def test_missing_triangle_gets_one_triangle():
    sphere = icosphere(2)
    filled = fill_holes(without(sphere, np.arange(320) == 7))
    assert len(filled.faces) == 320 and len(filled.vertices) == 162
    assert set(filled.faces[-1]) == set(sphere.faces[7])
    assert_closed_and_oriented(filled)


def test_no_edge_appears_twice():
    """A tube pinched to a strip: the best chord of its hole is an edge of the mesh already."""
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    tent = Mesh([*square, (0.5, 0.5, -1)], [(1, 0, 4), (2, 1, 4), (3, 2, 4), (0, 3, 4)])
    with_diagonal = Mesh([*square, (0.5, 0.5, -1), (2, 2, 2)], [*tent.faces, (0, 2, 5)])
    filled = fill_holes(with_diagonal, max_edges=4)
    assert (Mesh(filled.vertices, filled.faces).topology.edge_faces.counts <= 2).all()


def test_closed_meshes_and_long_holes_are_left_alone():
    for mesh, longest in ((icosphere(2), None), (without_cap(3, 0.5), 10)):
        filled = fill_holes(mesh, max_edges=longest)
        assert (filled.vertices == mesh.vertices).all() and (filled.faces == mesh.faces).all()


def test_chains_that_do_not_close_are_left_open():
    twisted = Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], [(0, 1, 2), (1, 2, 3)])
    assert boundary_loops(twisted) == []
    assert len(fill_holes(twisted).faces) == 2


def test_the_outer_boundary_of_a_sheet_that_hangs_on_a_vertex_is_kept():
    ball, sheet = icosphere(3), grid(2, 2)
    number = np.append(0, len(ball.vertices) + np.arange(8))  # of the vertices of the sheet
    both = Mesh(np.concatenate([ball.vertices, 2 + sheet.vertices[1:]]), [*ball.faces, *number[sheet.faces]])
    found, holes = filled(both, order=1, max_edges=None, outer="keep")
    assert [len(loop) for loop in holes.outer] == [8] and len(found.faces) == len(both.faces)


@pytest.mark.parametrize("outer", ["keep", "fill"])
@pytest.mark.parametrize("joined", [True, False])
def test_a_single_face_is_not_closed_with_its_reverse(joined, outer):
    ball = without_cap(2, 0.87)
    first = 0 if joined else len(ball.vertices)
    vertices = np.concatenate([ball.vertices, [(3, 0, 0), (3, 1, 0), (3, 0, 1)]])
    dangling = (first, *(len(ball.vertices) + np.arange(1, 3)))
    found, holes = filled(Mesh(vertices, [*ball.faces, dangling]), order=1, max_edges=None, outer=outer)
    assert len(holes.closed) == 1
    assert (np.isin(found.faces, dangling[1:]).any(axis=1)).sum() == 1
    assert_closed_and_oriented(Mesh(found.vertices, np.delete(found.faces, len(ball.faces), axis=0)))


@pytest.mark.parametrize("settings", [{"order": 4}, {"max_edges": 2}, {"outer": "both"}])
def test_bad_settings_are_refused(settings):
    with pytest.raises(ParameterError, match="must be"):
        fill_holes(without_cap(2, 0.5), **settings)


@pytest.mark.parametrize("exponent", [996, -900])
def test_the_size_of_the_coordinates_does_not_matter(exponent):
    holed = without_cap(3, 0.8)
    expected = fill_holes(holed)
    scaled = holed.moved(np.ldexp(holed.vertices, exponent))
    filled = fill_holes(scaled)
    np.testing.assert_array_equal(filled.faces, expected.faces)
    count = len(holed.vertices)
    assert filled.vertices[:count].tobytes() == scaled.vertices.tobytes()
    np.testing.assert_allclose(np.ldexp(filled.vertices, -exponent), expected.vertices, rtol=0, atol=1e-12)


def test_far_from_the_origin_nothing_is_lost():
    holed = without_cap(3, 0.8)
    expected, shift = fill_holes(holed), np.array([5e6, 4e6, 0])
    filled = fill_holes(holed.moved(holed.vertices + shift))
    np.testing.assert_array_equal(filled.faces, expected.faces)
    np.testing.assert_allclose(filled.vertices - shift, expected.vertices, rtol=0, atol=1e-7)


def test_faces_that_repeat_a_vertex_close_no_hole():
    mesh = without_cap(3, 0.9)
    loop = boundary_loops(mesh)[0]
    lines = np.stack([loop, np.roll(loop, 1), loop], axis=1)
    expected, found = fill_holes(mesh), fill_holes(Mesh(mesh.vertices, np.vstack([mesh.faces, lines])))
    np.testing.assert_array_equal(found.vertices, expected.vertices)
    np.testing.assert_array_equal(found.faces[: len(mesh.faces) + len(lines)], np.vstack([mesh.faces, lines]))
    np.testing.assert_array_equal(found.faces[-10:], expected.faces[-10:])


@pytest.mark.parametrize("corners", [(0, 1, 2), (2, 1, 0)])
def test_faces_that_repeat_others_close_no_hole(corners):
    ball = without_cap(2, 0.8)
    at_rim = ball.topology.boundary_vertices[ball.faces].sum(axis=1) == 2
    doubled = Mesh(ball.vertices, [*ball.faces, *ball.faces[at_rim][:3, corners]])
    patch = fill_holes(ball).faces[len(ball.faces) :]
    np.testing.assert_array_equal(fill_holes(doubled).faces[len(doubled.faces) :], patch)
    assert len(patch) > 0


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_the_outer_boundary_of_a_small_surface_is_kept(size):
    sheet = grid(size, size)
    np.testing.assert_array_equal(fill_holes(sheet).faces, sheet.faces)
    np.testing.assert_array_equal(fill_holes(Mesh(np.eye(3), [(0, 1, 2)])).faces, [(0, 1, 2)])


def test_the_outer_boundary_of_a_collapsed_face_is_kept():
    point = Mesh(np.zeros((3, 3)), [[0, 1, 2]])
    assert len(fill_holes(point).faces) == 1


def test_the_outer_boundary_of_an_open_surface_is_kept_and_holes_in_it_are_closed():
    plane = grid(12, 12)
    pierced = without(plane, (abs(plane.centroids[:, :2] - 6) < 3).all(axis=1))
    ball = without_cap(3, 0.87)
    faces = np.vstack([pierced.faces, ball.faces + len(pierced.vertices)])
    both = Mesh(np.vstack([pierced.vertices, ball.vertices + 30]), faces)
    kept, holes = filled(both, order=1, max_edges=None, outer="keep")
    assert [len(holes.closed), len(holes.outer), len(holes.long)] == [2, 1, 0]
    assert [len(loop) for loop in boundary_loops(kept)] == [48]
    assert fill_holes(pierced, order=1).area == pytest.approx(144, rel=1e-9)
    _, holes = filled(both, order=1, max_edges=40, outer="fill")
    assert [len(holes.closed), len(holes.outer), len(holes.long)] == [2, 0, 1]
    assert_closed_and_oriented(fill_holes(both, outer="fill"))


@pytest.mark.parametrize(("height", "open_surface"), [(0.4, False), (-0.4, True)])
def test_what_is_less_than_a_hemisphere_is_an_open_surface(height, open_surface):
    part = without_cap(4, height)
    assert (len(fill_holes(part).faces) == len(part.faces)) == open_surface
    rough = noisy(part, 0.2)  # which lengthens the boundary, and the area alike
    assert (len(fill_holes(rough).faces) == len(rough.faces)) == open_surface
