"""Geodesic distances are near the true ones, whatever the pose, the size and the order."""

import numpy as np
import potpourri3d
import pytest
from scipy.spatial.transform import Rotation
from shapes import grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.geometry.geodesics import geodesic_distances
from cascadenorm.mesh import Mesh


def heat(mesh, sources):
    return geodesic_distances(mesh, sources)


def prism(sides, rows):
    """An open tube of unit squares, each cut in two; angle and height of its vertices as columns and rows."""
    strip = grid(rows, sides)
    column, row = strip.vertices[:, 0].astype(int) % sides, strip.vertices[:, 1].astype(int)
    radius, angle = 0.5 / np.sin(np.pi / sides), 2 * np.pi * np.arange(sides) / sides
    place = np.tile(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1), (rows + 1, 1))
    vertices = np.column_stack([place, np.repeat(np.arange(rows + 1.0), sides)])
    return Mesh(vertices, (row * sides + column)[strip.faces])


def great_circles(sphere, source):
    return np.arccos(np.clip(sphere.vertices @ sphere.vertices[source], -1, 1))


def straight_lines(sheet, source):
    return np.linalg.norm(sheet.vertices - sheet.vertices[source], axis=1)


def around_tube(tube, source):
    """Distances on a tube of 20 sides are those of its unrolled strip."""
    column, row = np.arange(len(tube.vertices)) % 20, np.arange(len(tube.vertices)) // 20
    around = np.minimum((column - column[source]) % 20, (column[source] - column) % 20)
    return np.hypot(around, row - row[source])


def test_distances_on_the_sphere_converge():
    errors = [abs(heat(ball, 0) - great_circles(ball, 0)).max() for ball in map(icosphere, (2, 3, 4))]
    assert np.polyfit(np.log([4, 2, 1]), np.log(errors), 1)[0] > 0.45
    assert errors[-1] < 0.03


def test_heat_distances_equal_those_of_another_library_on_a_delaunay_mesh():
    sphere = icosphere(4)
    theirs = potpourri3d.MeshHeatMethodDistanceSolver(sphere.vertices, sphere.faces, use_robust=False)
    np.testing.assert_allclose(heat(sphere, 7), theirs.compute_distance(7), atol=2e-3)


@pytest.mark.parametrize(
    ("mesh", "distances"),
    [(icosphere(4), great_circles), (grid(30, 40), straight_lines), (prism(20, 30), around_tube)],
    ids=["sphere", "sheet", "tube"],
)
@pytest.mark.parametrize(("sources", "share"), [([7], 0.02), ([7, 300], 0.06)])
def test_heat_distances_are_as_near_to_the_true_ones_as_those_of_another_library(mesh, distances, sources, share):
    truth = np.min([distances(mesh, source) for source in sources], axis=0)
    found = heat(mesh, sources)
    theirs = potpourri3d.MeshHeatMethodDistanceSolver(mesh.vertices, mesh.faces).compute_distance_multisource(sources)
    error = abs(found - truth).mean()
    assert error < share * truth.mean()
    assert error < 1.15 * abs(theirs - truth).mean()
    assert (found[sources] == 0).all() and (found >= 0).all()


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_finer_and_coarser_components_do_not_matter(size):
    ball, other = icosphere(3), icosphere(4 if size < 1 else 1)
    vertices = np.concatenate([ball.vertices, size * (other.vertices + 3)])
    both = Mesh(vertices, np.concatenate([ball.faces, other.faces + len(ball.vertices)]))
    np.testing.assert_allclose(heat(both, 0)[: len(ball.vertices)], heat(ball, 0), rtol=1e-9, atol=1e-9)


def test_pose_scale_order_and_orientation_do_not_matter():
    mesh = noisy(icosphere(3), 0.1)
    expected = heat(mesh, [5, 70])
    rng = np.random.default_rng(0)
    turned = Rotation.random(random_state=1).apply(mesh.vertices.copy()) + 2
    faces = mesh.faces[rng.permutation(len(mesh.faces))]
    faces = np.where(rng.random(len(faces))[:, None] < 0.5, faces, faces[:, ::-1])
    np.testing.assert_allclose(heat(Mesh(turned, faces), [5, 70]), expected, rtol=1e-7, atol=1e-9)
    for factor in (1e-200, 1e150):
        np.testing.assert_allclose(heat(Mesh(factor * mesh.vertices, mesh.faces), [5, 70]), factor * expected)


def test_faces_that_repeat_others_count_once():
    ball = noisy(icosphere(3), 0.1)
    other = Mesh(ball.vertices, [*ball.faces, *ball.faces[:300, ::-1]])
    np.testing.assert_allclose(geodesic_distances(other, 0), geodesic_distances(ball, 0), atol=1e-12)


def test_what_no_source_is_connected_to_is_infinitely_far():
    ball = icosphere(2)
    vertices = np.concatenate([ball.vertices, [[9, 9, 9]], ball.vertices + 4])
    mesh = Mesh(vertices, np.concatenate([ball.faces, ball.faces + 163]))
    alone = heat(ball, [3])
    found = heat(mesh, [3])
    np.testing.assert_allclose(found[:162], alone, rtol=1e-9)
    assert np.isinf(found[162:]).all()
    found = heat(mesh, [3, 162, 166])
    np.testing.assert_allclose(found[163:], alone, rtol=1e-9)
    np.testing.assert_allclose(found[:162], alone, rtol=1e-9)
    assert found[162] == 0
    assert np.isinf(np.delete(heat(mesh, [162]), 162)).all()


def test_heat_reaches_the_end_of_a_long_strip():
    strip = grid(1, 3000)
    found = heat(strip, [0])
    np.testing.assert_allclose(found, strip.vertices[:, 0], rtol=0.01, atol=2)


@pytest.mark.parametrize("place", [1.0, 5.0], ids=["one place", "two places"])
def test_faces_without_extent_are_refused(place):
    vertices = np.repeat([[1.0, 1, 1], [place, 1, 1]], 3, axis=0)
    with pytest.raises(cn.MeshError, match="no face of the mesh has an extent"):
        cn.geodesic_distances(Mesh(vertices, [[0, 1, 2], [3, 4, 5]]), 0)


@pytest.mark.parametrize(
    "sources, words",
    [
        ([], "a vertex index"),
        ([0.5], "a vertex index"),
        ([[0, 1], [2]], "a vertex index"),
        ([-1], "contains -1"),
        (42, "vertex indices go from 0 to 41"),
    ],
)
def test_wrong_sources_are_refused(sources, words):
    ball = icosphere(1)
    with pytest.raises(cn.ParameterError, match=f"sources .*{words}"):
        cn.geodesic_distances(ball, sources)
