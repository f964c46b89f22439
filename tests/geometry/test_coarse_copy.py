"""A coarse copy has the topology of its mesh and carries the mesh along."""

import numpy as np
import pytest
from shapes import cube, grid, icosphere, noisy

from cascadenorm.geometry.coarse_copy import LEAST_CLUSTERS, coarse_copy, foot
from cascadenorm.geometry.nearest import SurfaceTree
from cascadenorm.mesh import Mesh


def torus(radius: float, tube: float, around: int, across: int) -> Mesh:
    """A closed grid of around × across vertices over a torus about the z axis."""
    u, v = np.meshgrid(np.arange(around), np.arange(across), indexing="ij")
    a, b = 2 * np.pi * u / around, 2 * np.pi * v / across
    ring = radius + tube * np.cos(b)
    places = np.stack([ring * np.cos(a), ring * np.sin(a), tube * np.sin(b)], axis=-1).reshape(-1, 3)
    right, up = (u + 1) % around * across + v, u * across + (v + 1) % across
    own, both = u * across + v, (u + 1) % around * across + (v + 1) % across
    faces = np.concatenate([np.stack([own, right, both], -1), np.stack([own, both, up], -1)]).reshape(-1, 3)
    return Mesh(places, faces)


def characteristic(mesh: Mesh) -> int:
    return int(mesh.topology.used_vertices.sum() - len(mesh.topology.edges) + len(mesh.faces))


@pytest.mark.parametrize("length", [0.2, 0.4, 0.8])
def test_a_copy_of_a_sphere_is_a_sphere_of_edges_about_that_long(length):
    copy = coarse_copy(noisy(icosphere(5), 0.1), length).mesh
    assert (copy.topology.edge_faces.counts == 2).all() and characteristic(copy) == 2
    longest = np.sqrt(4 * np.pi / LEAST_CLUSTERS / np.sqrt(0.75))
    assert copy.mean_edge_length == pytest.approx(min(length, longest), rel=0.25)
    assert copy.volume > 0


def test_a_copy_neither_shrinks_nor_grows():
    ball = icosphere(5)
    copy = coarse_copy(ball, 0.3)
    radii = np.linalg.norm(copy.carried_over(ball.vertices, copy.mesh.vertices), axis=1)
    assert abs(radii.mean() - 1) < 0.02 * 0.3**2  # chords alone are 0.17 · 0.3² too low
    assert radii.min() > 1 - 0.3**2 / 4


@pytest.mark.parametrize("length", [0.3, 1.0])
def test_a_tube_thinner_than_the_edges_stays_a_tube(length):
    ring = torus(1.0, 0.1, 200, 20)
    copy = coarse_copy(ring, length)
    assert (copy.mesh.topology.edge_faces.counts == 2).all() and characteristic(copy.mesh) == 0
    moved = copy.carried_over(ring.vertices, copy.mesh.vertices)
    assert np.linalg.norm(moved - ring.vertices, axis=1).max() < 0.1


@pytest.mark.parametrize("shift", [(0, 0, 0), (0.5, -2, 3)], ids=["still", "shifted"])
def test_an_open_sheet_goes_where_its_copy_goes_up_to_its_corners(shift):
    sheet = grid(30, 20)
    copy = coarse_copy(sheet, 4.0)
    moved = copy.carried_over(sheet.vertices, copy.mesh.vertices + shift)
    np.testing.assert_allclose(moved, sheet.vertices + shift, atol=1e-9)


def test_faces_that_occur_twice_make_the_copy_of_faces_that_occur_once():
    ball = icosphere(4)
    for again in (ball.faces, ball.faces[:, ::-1]):
        copy = coarse_copy(Mesh(ball.vertices, np.concatenate([ball.faces, again])), 0.4).mesh
        assert (copy.topology.edge_faces.counts == 2).all() and characteristic(copy) == 2


def test_each_component_is_copied_and_small_ones_keep_their_vertices():
    balls = [icosphere(4), icosphere(1)]
    vertices = np.concatenate([balls[0].vertices, [[9.0, 9, 9]], 0.1 * balls[1].vertices + 3])
    mesh = Mesh(vertices, np.concatenate([balls[0].faces, balls[1].faces + len(balls[0].vertices) + 1]))
    copy = coarse_copy(mesh, 5.0)
    components = np.unique(copy.mesh.topology.components, return_counts=True)[1]
    assert components.tolist() == [pytest.approx(LEAST_CLUSTERS, rel=0.3), len(balls[1].vertices)]
    moved = copy.carried_over(vertices, copy.mesh.vertices)
    assert moved[len(balls[0].vertices)].tolist() == [9.0, 9, 9]
    assert np.linalg.norm(moved - vertices, axis=1).max() < 0.2


def test_sheets_that_lie_close_together_are_told_apart():
    low, high = grid(30, 30), grid(30, 30).vertices + np.array([0.3, 0.2, 0.01])
    mesh = Mesh(np.concatenate([low.vertices, high]), np.concatenate([low.faces, low.faces + len(high)]))
    copy = coarse_copy(mesh, 5.0)
    lifted = copy.mesh.vertices + np.where(copy.mesh.vertices[:, 2:] > 0.005, 7.0, 0.0) * (0, 0, 1)
    moved = copy.carried_over(mesh.vertices, lifted)
    np.testing.assert_allclose(moved[:, 2], np.repeat([0, 7.01], len(high)), atol=1e-9)


def test_three_sheets_along_one_edge_stay_three():
    flat = grid(10, 20)
    sheets = [flat.vertices @ turn for turn in (np.eye(3), np.diag([1.0, -1, 1]), np.eye(3)[[0, 2, 1]])]
    vertices, which = np.unique(np.round(np.concatenate(sheets), 9) + 0.0, axis=0, return_inverse=True)
    faces = which.reshape(-1)[np.concatenate([flat.faces + k * len(flat.vertices) for k in range(3)])]
    mesh = Mesh(vertices, faces)
    copy = coarse_copy(mesh, 3.0)
    assert (copy.mesh.topology.edge_faces.counts == 3).sum() >= 4
    assert np.linalg.norm(copy.carried_over(vertices, copy.mesh.vertices) - vertices, axis=1).max() < 1.5


def test_a_point_and_its_foot_are_as_far_apart_as_the_exact_search_says():
    mesh = noisy(cube(3), 0.3)
    points = np.random.default_rng(0).normal(size=(200, 3)) * 2
    found = SurfaceTree(mesh).nearest(points)
    for point, face, distance in zip(points, found.faces, found.distances, strict=True):
        corners = mesh.vertices[mesh.faces[face]]
        *weights, squared = foot(point, *corners)
        assert min(weights) >= 0 and sum(weights) == pytest.approx(1)
        assert squared == pytest.approx(distance**2, rel=1e-9)
        assert np.linalg.norm(point - weights @ corners) == pytest.approx(distance, rel=1e-9)


def test_a_ribbon_that_clusters_span_has_no_copy():
    assert coarse_copy(grid(1, 100_000), 1e4) is None
