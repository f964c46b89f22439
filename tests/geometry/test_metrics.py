"""Measures of a mesh against the truth are those of known displacements and turns."""

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

from cascadenorm.geometry.metrics import measure
from cascadenorm.mesh import Mesh, MeshError

BALL = icosphere(3)


def turned(mesh: Mesh, degrees: float, axis: int) -> Mesh:
    """Return the mesh turned about a coordinate axis."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    matrix = np.roll(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), (axis + 1, axis + 1), axis=(0, 1))
    return mesh.moved(mesh.vertices @ matrix.T)


def test_a_mesh_is_no_error_away_from_itself():
    found = measure(noisy(icosphere(2), 0.1), noisy(icosphere(2), 0.1))
    assert found.normal_error_deg == found.normal_error_rms_deg == found.normal_error_p95_deg == 0
    assert found.flipped_percent == 0
    assert found.hausdorff_diagonal < 1e-15
    assert found.vertex_error_edges < 1e-15
    assert found.volume_ratio == 1


def test_a_larger_sphere_is_off_by_the_difference_of_the_radii():
    small = icosphere(3)
    found = measure(small.moved(1.02 * small.vertices), small)
    assert found.normal_error_deg == pytest.approx(0, abs=1e-12)
    assert found.vertex_error_edges == pytest.approx(0.02 / small.mean_edge_length, rel=1e-12)
    assert found.hausdorff_diagonal == pytest.approx(0.02 / small.diagonal, rel=1e-12)
    assert found.volume_ratio == pytest.approx(1.02**3, rel=1e-12)


def test_a_lifted_plane_is_off_by_its_height_in_edges_of_the_true_mesh():
    plane = grid(4, 5)
    found = measure(plane.moved(plane.vertices + np.array([0, 0, 0.3])), plane)
    assert found.vertex_error_edges == pytest.approx(0.3 / plane.mean_edge_length, rel=1e-12)
    assert found.hausdorff_diagonal == pytest.approx(0.3 / np.hypot(4, 5), rel=1e-12)
    assert found.normal_error_deg == 0
    assert found.volume_ratio is None


def test_hausdorff_looks_both_ways_and_the_vertex_error_one():
    plane = grid(4, 8)
    part = Mesh(plane.vertices, plane.faces[(plane.centroids[:, 0] < 4)])
    assert measure(part, plane).vertex_error_edges == 0
    assert measure(part, plane).hausdorff_diagonal == pytest.approx(4 / np.hypot(4, 8), rel=1e-12)
    assert measure(plane, part).vertex_error_edges > 0


@pytest.mark.parametrize("degrees", [1e-5, 7.0, 89.0, 91.0, 180.0])
def test_a_turned_plane_is_off_by_the_angle(degrees):
    plane = grid(3, 3)
    found = measure(turned(plane, degrees, axis=0), plane)
    assert found.normal_error_deg == pytest.approx(degrees, rel=1e-9)
    assert found.normal_error_p95_deg == pytest.approx(degrees, rel=1e-9)
    assert found.flipped_percent == (100 if degrees > 90 else 0)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_cube_turned_about_its_axis_is_off_on_four_sides_of_six(axis):
    found = measure(turned(cube(4), 12, axis), cube(4))
    assert found.normal_error_deg == pytest.approx(12 * 4 / 6, rel=1e-9)
    assert found.normal_error_rms_deg == pytest.approx(12 * np.sqrt(4 / 6), rel=1e-9)
    assert found.volume_ratio == pytest.approx(1, rel=1e-12)


def test_the_mean_by_area_weights_faces_by_their_true_area():
    """Of a sheet folded along a line at a third, that third of the area turns, in two thirds of the faces."""
    strip = grid(1, 3)
    x = np.array([0, 0.5, 1, 3.0])[strip.vertices[:, 0].astype(int)]
    flat = strip.moved(np.column_stack([x, strip.vertices[:, 1:]]))
    lifted = flat.vertices.copy()
    first = lifted[:, 0] < 1
    lifted[first, 2] = np.tan(np.radians(20)) * (1 - lifted[first, 0])
    found = measure(flat.moved(lifted), flat)
    assert found.normal_error_deg == pytest.approx(20 * 2 / 3, rel=1e-9)
    assert found.normal_error_area_deg == pytest.approx(20 / 3, rel=1e-9)


def test_the_root_mean_square_counts_far_vertices_more():
    plane = grid(4, 5)
    lifted = plane.vertices.copy()
    lifted[7, 2] = 0.3
    found = measure(plane.moved(lifted), plane)
    count = len(plane.vertices)
    assert found.vertex_rms_edges == pytest.approx(0.3 / np.sqrt(count) / plane.mean_edge_length, rel=1e-12)
    assert found.vertex_error_edges == pytest.approx(0.3 / count / plane.mean_edge_length, rel=1e-12)


def test_meshes_with_other_faces_are_compared_at_their_nearest_points():
    found = measure(cube(7), cube(4))
    assert found.normal_error_deg == pytest.approx(0, abs=1e-6)
    assert found.vertex_error_edges == pytest.approx(0, abs=1e-12)
    assert found.hausdorff_diagonal == pytest.approx(0, abs=1e-12)
    small = turned(grid(3, 7), 5, axis=0)
    assert measure(small, grid(4, 4)).normal_error_deg == pytest.approx(5, rel=1e-9)


def test_order_of_faces_does_not_matter():
    rough, clean = noisy(icosphere(2), 0.1), icosphere(2)
    order = np.random.default_rng(0).permutation(len(clean.faces))
    shuffled = measure(Mesh(rough.vertices, rough.faces[order]), Mesh(clean.vertices, clean.faces[order]))
    expected = measure(rough, clean)
    assert shuffled.normal_error_deg == pytest.approx(expected.normal_error_deg, rel=1e-12)
    assert shuffled.vertex_error_edges == expected.vertex_error_edges


def test_measures_do_not_change_with_the_scale():
    rough, clean = noisy(icosphere(2), 0.2), icosphere(2)
    expected = measure(rough, clean)
    for scale in (2.0**30, 2.0**-30):
        assert measure(rough.moved(rough.vertices * scale), clean.moved(clean.vertices * scale)) == expected


def test_faces_without_area_have_no_angle():
    plane = grid(2, 2)
    tilted = turned(plane, 10, axis=0)
    flat_face = [[0, 1, 1]]
    found = measure(
        Mesh(tilted.vertices, np.concatenate([tilted.faces, flat_face])),
        Mesh(plane.vertices, np.concatenate([plane.faces, flat_face])),
    )
    assert found.normal_error_deg == pytest.approx(10, rel=1e-9)
    with pytest.raises(MeshError, match="no face has an area in both meshes"):
        measure(Mesh(plane.vertices, flat_face), plane)


def test_faces_that_repeat_a_vertex_change_nothing():
    rough, clean = noisy(icosphere(2), 0.1), icosphere(2)
    lines = [[0, 0, 1], [5, 5, 5], [3, 90, 3]]
    found = measure(*(Mesh(one.vertices, np.concatenate([one.faces, lines])) for one in (rough, clean)))
    assert found == measure(rough, clean)  # also closed, with the same mean edge length


@pytest.mark.parametrize("of_both", [True, False])
@pytest.mark.parametrize("repeated", [320, 1])
def test_faces_that_repeat_others_change_nothing(repeated, of_both):
    clean = icosphere(2)
    rough = noisy(clean, 0.1)
    more = [*clean.faces, *clean.faces[:repeated, ::-1]]
    found = measure(Mesh(rough.vertices, more), Mesh(clean.vertices, more) if of_both else clean)
    assert found == measure(rough, clean)


def test_a_reference_without_extent_is_refused():
    with pytest.raises(MeshError, match="at one place"):
        measure(grid(1, 1), Mesh(np.zeros((3, 3)), [[0, 1, 2]]))


@pytest.mark.parametrize("scale", [1e300, 1.5e308, 1e-300, 1e-310])
def test_the_size_of_the_coordinates_does_not_matter(scale):
    clean, rough = icosphere(2), noisy(icosphere(2), 0.1)
    largest = max(np.abs(m.vertices).max() for m in (clean, rough))
    small = [m.moved(m.vertices / largest) for m in (rough, clean)]
    expected = measure(*small)
    found = measure(*(m.moved(m.vertices * scale) for m in small))
    for name, value in vars(expected).items():
        assert getattr(found, name) == pytest.approx(value, rel=1e-9 if scale > 1e-308 else 1e-5), name


def test_vertices_without_a_face_count_nowhere():
    clean, rough = icosphere(2), noisy(icosphere(2), 0.1)
    stray = [Mesh(np.concatenate([m.vertices, [[1e300, 0, 5]]]), m.faces) for m in (rough, clean)]
    assert vars(measure(*stray)) == pytest.approx(vars(measure(rough, clean)), rel=1e-12)


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("mesh", "told"),
    [
        (BALL.moved(BALL.vertices + np.array([9, 0, 0])), r"2\.\d+ diagonals of the reference away from it"),
        (BALL.moved(1000 * BALL.vertices), r"and it is 1e\+03 times as large:"),
        (BALL.moved(0.001 * BALL.vertices), "and it is 0.001 times as large:"),
    ],
)
def test_meshes_that_have_nothing_to_do_with_each_other_are_refused(mesh, told):
    with pytest.raises(MeshError, match=told):
        measure(mesh, BALL)


@pytest.mark.compiled
def test_a_part_of_the_reference_and_a_rough_mesh_are_measured():
    cap = Mesh(BALL.vertices, BALL.faces[BALL.centroids[:, 2] > 0.9])
    assert measure(cap, BALL).normal_error_deg == 0
    measure(noisy(BALL, 2.0), BALL)


def test_meshes_of_sizes_beyond_measure_are_refused():
    ball = icosphere(1)
    with pytest.raises(MeshError, match=r"one mesh is over 1e\+90 times as large as the other"):
        measure(ball, ball.moved(ball.vertices * 1e300))
    with pytest.raises(MeshError, match="are at one place"):
        measure(ball.moved(ball.vertices * 1e300), ball.moved(ball.vertices * 0))
