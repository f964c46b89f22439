import numpy as np
import potpourri3d
import pytest
from reference import shortest_paths
from scipy.spatial.transform import Rotation
from shapes import cube, grid, icosphere, noisy

import cascadenorm as cn
from cascadenorm.geometry.geodesics import geodesic_distances
from cascadenorm.mesh import Mesh


def exact(mesh, sources):
    return geodesic_distances(mesh, sources, method="exact")


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


def test_exact_on_the_plane():
    plane = grid(15, 20)
    for sources in ([0], [150], [3, 150, 330]):
        direct = np.linalg.norm(plane.vertices[:, None] - plane.vertices[sources], axis=2).min(axis=1)
        np.testing.assert_allclose(exact(plane, sources), direct, atol=1e-12)


def test_exact_on_a_tube_is_that_of_its_unrolled_strip():
    tube = prism(12, 9)
    column, row = np.arange(len(tube.vertices)) % 12, np.arange(len(tube.vertices)) // 12
    around = np.minimum((column - 5) % 12, (5 - column) % 12)
    np.testing.assert_allclose(exact(tube, 4 * 12 + 5), np.hypot(around, row - 4), atol=1e-12)


def test_exact_on_the_cube():
    box = cube(4)
    corner = np.flatnonzero((box.vertices == -1).all(axis=1))
    opposite = (box.vertices == 1).all(axis=1)
    assert exact(box, corner)[opposite] == pytest.approx(np.sqrt(4**2 + 2**2), abs=1e-12)


def test_exact_around_a_corner_of_the_boundary_bends_there():
    square = grid(8, 8)
    sheet = Mesh(square.vertices, square.faces[(square.centroids[:, :2] < 4).any(axis=1)])  # an L
    source, bend = 8 * 9 + 4, 4 * 9 + 4  # the end of one arm, above the inner corner
    hidden = sheet.vertices[:, 0] > 4
    hidden &= sheet.topology.used_vertices
    beyond = 4 + np.linalg.norm(sheet.vertices - sheet.vertices[bend], axis=1)
    np.testing.assert_allclose(exact(sheet, source)[hidden], beyond[hidden], atol=1e-12)


@pytest.mark.parametrize("clean, level", [(icosphere(0), 0.5), (grid(4, 5), 0.3), (cube(2), 0.2)])
def test_exact_equals_the_shortest_of_all_unfoldings(clean, level):
    mesh = noisy(clean, level)
    found = [exact(mesh, source) for source in range(len(mesh.vertices))]
    np.testing.assert_allclose(found, shortest_paths(mesh), rtol=1e-10, atol=1e-12)


def test_no_geodesic_path_of_another_library_is_shorter_than_the_exact_distance():
    sphere = icosphere(4)
    paths = potpourri3d.EdgeFlipGeodesicSolver(sphere.vertices, sphere.faces)
    distances = exact(sphere, 7)
    chosen = np.random.default_rng(0).choice(np.arange(8, len(distances)), 150, replace=False)
    lengths = [np.linalg.norm(np.diff(paths.find_geodesic_path(7, v), axis=0), axis=1).sum() for v in chosen]
    excess = np.array(lengths) / distances[chosen] - 1
    assert excess.min() > -1e-12
    assert (excess < 1e-9).mean() > 0.5


def test_distances_on_the_sphere_converge():
    for distances, order, small in ((exact, 1.9, 2e-3), (heat, 0.45, 0.03)):
        errors = [abs(distances(ball, 0) - great_circles(ball, 0)).max() for ball in map(icosphere, (2, 3, 4))]
        assert np.polyfit(np.log([4, 2, 1]), np.log(errors), 1)[0] > order
        assert errors[-1] < small


def test_heat_distances_equal_those_of_another_library_on_a_delaunay_mesh():
    sphere = icosphere(4)
    theirs = potpourri3d.MeshHeatMethodDistanceSolver(sphere.vertices, sphere.faces, use_robust=False)
    np.testing.assert_allclose(heat(sphere, 7), theirs.compute_distance(7), atol=2e-3)


@pytest.mark.parametrize(
    "mesh", [noisy(icosphere(4), 0.2), noisy(grid(30, 40), 0.2), prism(20, 30)], ids=["sphere", "sheet", "tube"]
)
@pytest.mark.parametrize("sources, share", [([7], 0.02), ([7, 300], 0.06)])
def test_heat_distances_are_as_near_to_the_exact_ones_as_those_of_another_library(mesh, sources, share):
    truth = exact(mesh, sources)
    found = heat(mesh, sources)
    theirs = potpourri3d.MeshHeatMethodDistanceSolver(mesh.vertices, mesh.faces).compute_distance_multisource(sources)
    error = abs(found - truth).mean()
    assert error < share * truth.mean()
    assert error < 1.15 * abs(theirs - truth).mean()
    assert (found[sources] == 0).all() and (found >= 0).all()


def test_distances_to_several_sources_are_the_least_of_each_and_symmetric():
    mesh = noisy(grid(20, 20), 0.3)
    each = np.array([exact(mesh, source) for source in (3, 200, 431)])
    np.testing.assert_allclose(exact(mesh, [431, 3, 200, 3]), each.min(axis=0), rtol=1e-12)
    np.testing.assert_allclose(each[:, [3, 200, 431]], each[:, [3, 200, 431]].T, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("distances", [exact, heat])
def test_pose_scale_order_and_orientation_do_not_matter(distances):
    mesh = noisy(icosphere(3), 0.1)
    expected = distances(mesh, [5, 70])
    rng = np.random.default_rng(0)
    turned = Rotation.random(random_state=1).apply(mesh.vertices.copy()) + 2
    faces = mesh.faces[rng.permutation(len(mesh.faces))]
    faces = np.where(rng.random(len(faces))[:, None] < 0.5, faces, faces[:, ::-1])
    np.testing.assert_allclose(distances(Mesh(turned, faces), [5, 70]), expected, rtol=1e-7, atol=1e-9)
    for factor in (1e-200, 1e150):
        np.testing.assert_allclose(distances(Mesh(factor * mesh.vertices, mesh.faces), [5, 70]), factor * expected)


@pytest.mark.parametrize("distances", [exact, heat])
def test_what_no_source_is_connected_to_is_infinitely_far(distances):
    ball = icosphere(2)
    vertices = np.concatenate([ball.vertices, [[9, 9, 9]], ball.vertices + 4])
    mesh = Mesh(vertices, np.concatenate([ball.faces, ball.faces + 163]))
    alone = distances(ball, [3])
    found = distances(mesh, [3])
    np.testing.assert_allclose(found[:162], alone, rtol=1e-9)
    assert np.isinf(found[162:]).all()
    found = distances(mesh, [3, 162, 166])
    np.testing.assert_allclose(found[163:], alone, rtol=1e-9)
    np.testing.assert_allclose(found[:162], alone, rtol=1e-9)
    assert found[162] == 0
    assert np.isinf(np.delete(distances(mesh, [162]), 162)).all()


def test_pages_of_a_book_are_flat_two_by_two():
    page = grid(6, 6)
    turns = [Rotation.from_rotvec((0, a, 0)).apply(page.vertices.copy()) for a in (0, 2, 4)]
    spine = page.vertices[:, 0] == 0
    numbers = np.arange(49)[:, None] + 49 * np.arange(3)
    numbers[spine] = numbers[spine, :1]
    mesh = Mesh(np.concatenate(turns), np.concatenate([numbers[:, k][page.faces] for k in range(3)]))
    distances = exact(mesh, 5)
    flat = np.linalg.norm(page.vertices * (-1, 1, 1) - page.vertices[5], axis=1)
    for k in (1, 2):
        np.testing.assert_allclose(distances[numbers[:, k]], flat, atol=1e-12)


def test_two_parts_that_touch_in_a_vertex_are_passed_there():
    ball = noisy(icosphere(2), 0.1)
    tip = 11
    numbers = np.where(np.arange(162) == tip, tip, np.arange(162) + 162)
    vertices = np.concatenate([ball.vertices, 2 * ball.vertices[tip] - ball.vertices])
    mesh = Mesh(vertices, np.concatenate([ball.faces, numbers[ball.faces]]))
    found = exact(mesh, 40)
    np.testing.assert_allclose(
        found[162:][np.arange(162) != tip], (found[tip] + exact(ball, tip))[np.arange(162) != tip]
    )


def test_degenerate_faces_are_no_shortcut_and_no_obstacle():
    plane = grid(6, 6)
    cut = np.concatenate([plane.vertices, [[3.5, 3.0, 0]]])  # on the edge between two vertices: a face without area
    i, j = 3 * 7 + 3, 3 * 7 + 4
    mesh = Mesh(cut, np.concatenate([plane.faces, [(i, 49, j), (0, 0, 48)]]))
    np.testing.assert_allclose(exact(mesh, 10)[:49], exact(plane, 10), atol=1e-12)


def test_heat_reaches_the_end_of_a_long_strip():
    strip = grid(1, 3000)
    found = heat(strip, [0])
    np.testing.assert_allclose(found, strip.vertices[:, 0], rtol=0.01, atol=2)


@pytest.mark.parametrize(
    "sources, words",
    [([], "a vertex index"), ([0.5], "a vertex index"), ([-1], "contains -1"), (42, "vertex indices go from 0 to 41")],
)
def test_wrong_sources_are_refused(sources, words):
    ball = icosphere(1)
    with pytest.raises(cn.ParameterError, match=f"sources .*{words}"):
        cn.geodesic_distances(ball, sources)


def test_an_unknown_method_is_refused():
    with pytest.raises(cn.ParameterError, match="method is 'fast'; it must be heat or exact"):
        cn.geodesic_distances((np.eye(3), [[0, 1, 2]]), 0, method="fast")
