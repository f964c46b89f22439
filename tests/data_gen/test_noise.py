"""Noise has the level and the direction that it claims."""

import numpy as np
import pytest
from shapes import cube, grid, icosphere

from cascadenorm.data_gen import displacements
from cascadenorm.data_gen.meshing.lattice import sample
from cascadenorm.data_gen.meshing.polygonise import dual_contouring
from cascadenorm.data_gen.noise.noise import relief
from cascadenorm.data_gen.noise.sensor import camera_errors
from cascadenorm.data_gen.shapes.fields import sphere
from cascadenorm.mesh import Mesh


@pytest.fixture(scope="module")
def ball():
    field, rng = sphere(radius=1), np.random.default_rng(0)
    return dual_contouring(field, sample(field, lower=[-1.1] * 3, upper=[1.1] * 3, spacing=0.06, jitter=0.1, rng=rng))


def test_vertex_normals_of_the_sphere_are_radial(ball):
    radial = ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", ball.vertex_normals, radial).min() > 0.99


@pytest.mark.parametrize("level", [0.05, 0.3])
def test_gaussian_noise_along_normals_has_its_level_and_moves_along_normals_only(ball, level):
    moved = displacements(ball, "normal", level=level, rng=np.random.default_rng(1)) / ball.mean_edge_length
    along = np.einsum("ij,ij->i", moved, ball.vertex_normals)
    np.testing.assert_allclose(moved, along[:, None] * ball.vertex_normals, atol=1e-14)
    count = len(ball.vertices)
    assert along.std() == pytest.approx(level, rel=5 / np.sqrt(2 * count))
    assert abs(along.mean()) < 5 * level / np.sqrt(count)


@pytest.mark.parametrize("kind", ["gaussian", "uniform"])
def test_noise_in_all_directions_has_its_level_in_each_coordinate(ball, kind):
    moved = displacements(ball, kind, level=0.2, rng=np.random.default_rng(2)) / ball.mean_edge_length
    np.testing.assert_allclose(moved.std(axis=0), 0.2, rtol=5 / np.sqrt(2 * len(moved)))
    correlation = np.corrcoef(moved.T) - np.eye(3)
    assert np.abs(correlation).max() < 5 / np.sqrt(len(moved))
    if kind == "uniform":
        assert np.abs(moved).max() <= 0.2 * np.sqrt(3)


def test_impulsive_noise_leaves_some_vertices_alone_and_hits_the_rest_at_its_level(ball):
    moved = displacements(ball, "impulsive", level=0.4, rng=np.random.default_rng(3)) / ball.mean_edge_length
    hit = np.abs(moved).max(axis=1) > 0
    assert 0.03 < hit.mean() < 0.65
    along = np.einsum("ij,ij->i", moved, ball.vertex_normals)[hit]
    assert along.std() == pytest.approx(0.4, rel=6 / np.sqrt(2 * hit.sum()))


def test_varying_noise_has_its_level_over_all_and_others_in_places(ball):
    moved = displacements(ball, "varying", level=0.3, rng=np.random.default_rng(4)) / ball.mean_edge_length
    size = np.linalg.norm(moved, axis=1)
    assert np.sqrt(np.mean(size**2)) == pytest.approx(0.3, rel=0.15)
    by_place = [size[(ball.vertices @ axis) > 0.8].mean() for axis in np.concatenate([np.eye(3), -np.eye(3)])]
    assert max(by_place) > 1.5 * min(by_place)


def test_a_depth_camera_errs_along_its_view_and_by_its_level_from_pixel_to_pixel():
    x, y = (a.ravel() for a in np.meshgrid(np.arange(60.0), np.arange(60.0)))
    first = (np.arange(59)[:, None] * 60 + np.arange(59)).ravel()
    faces = np.concatenate([np.stack([first, first + 1, first + 61], 1), np.stack([first, first + 61, first + 60], 1)])
    slope = Mesh(np.stack([x, y, 0.3 * x], axis=1), faces)
    normal = np.array([-0.3, 0, 1]) / np.sqrt(1.09)
    steps, sizes = [], []
    for seed in range(40):
        moved = displacements(slope, "sensor", level=0.2, rng=np.random.default_rng(seed)) / slope.mean_edge_length
        np.testing.assert_allclose(np.cross(moved, normal), 0, atol=1e-12)
        ends = (moved @ normal)[slope.topology.edges]
        steps.append(np.sqrt(0.5 * np.mean((ends[:, 0] - ends[:, 1]) ** 2)))
        sizes.append(np.sqrt(np.mean(moved**2) * 3))
    assert 0.1 < np.median(steps) < 0.3
    assert np.median(sizes) > 1.5 * np.median(steps)  # neighbours err alike


@pytest.mark.parametrize("seed", range(4))
def test_a_laser_scanner_errs_along_the_view_alike_over_a_step_or_two_of_the_grid(seed):
    flat = grid(60, 60)
    errors = displacements(flat, "laser", level=0.13, rng=np.random.default_rng(seed)) / flat.mean_edge_length
    np.testing.assert_allclose(errors[:, :2], 0, atol=1e-12)
    assert np.sqrt(np.mean(errors[:, 2] ** 2)) == pytest.approx(0.13)
    heights = errors[:, 2].reshape(61, 61)
    one, four = (np.corrcoef(heights[:, step:].ravel(), heights[:, :-step].ravel())[0, 1] for step in (1, 4))
    assert 0.15 < one < 0.85
    assert abs(four) < 0.15


def test_the_error_of_a_laser_scanner_is_larger_at_the_boundary_of_a_scan():
    flat = grid(60, 60)
    boundary = flat.topology.boundary_vertices
    draws = [displacements(flat, "laser", level=0.13, rng=np.random.default_rng(seed))[:, 2] for seed in range(20)]
    ratios = [np.std(errors[boundary]) / np.std(errors[~boundary]) for errors in draws]
    assert np.min(ratios) > 0.8 and 1.3 < np.median(ratios) < 5


@pytest.mark.parametrize("kind", ["sensor", "laser"])
def test_a_closed_surface_is_seen_from_any_side(kind):
    """Its mean normal is zero up to rounding, and exactly zero for a cube."""
    box = cube(4)
    moved = [displacements(box, kind, level=0.2, rng=np.random.default_rng(seed)) for seed in range(4)]
    views = [errors[0] / np.linalg.norm(errors[0]) for errors in moved]
    for errors, view in zip(moved, views, strict=True):
        assert np.abs(np.cross(errors, view)).max() < 1e-12
    assert np.linalg.matrix_rank(np.array(views), tol=0.1) == 3


def test_a_depth_camera_sees_nothing_behind_itself():
    """Coarse steps of the disparity may round it to nothing."""
    x, y = np.meshgrid(np.arange(11.0), np.arange(11.0))
    pixels = grid(10, 10)
    distance = np.hypot(np.hypot(x, y), 12.0).ravel()
    for seed in range(200):
        errors = camera_errors(distance, pixels, 2.0, rng=np.random.default_rng(seed))
        assert (np.abs(errors) < 20 * distance.max()).all() and (distance - errors > 0).all()


@pytest.mark.parametrize("seed", range(8))
def test_relief_is_smooth_at_the_scale_of_the_edges_and_along_the_normals(seed):
    mesh = icosphere(5)
    moves = relief(mesh, rng=np.random.default_rng(seed))
    along = np.einsum("ij,ij->i", moves, mesh.vertex_normals)
    np.testing.assert_allclose(moves, along[:, None] * mesh.vertex_normals, atol=1e-14)
    a, b = mesh.topology.edges.T
    assert np.corrcoef(along[a], along[b])[0, 1] > 0.4
    assert 0.005 < along.std() / mesh.mean_edge_length < 2.5


def test_no_noise_is_the_identity(ball):
    rng = np.random.default_rng(5)
    np.testing.assert_array_equal(displacements(ball, "none", level=0.5, rng=rng), 0)
    for kind in ("normal", "gaussian", "uniform", "impulsive", "varying", "mixed", "sensor"):
        np.testing.assert_array_equal(displacements(ball, kind, level=0.0, rng=rng), 0)


def test_noise_scales_with_the_mesh(ball):
    for kind in ("normal", "gaussian", "impulsive", "varying", "mixed"):
        one = displacements(ball, kind, level=0.2, rng=np.random.default_rng(6))
        large = displacements(ball.moved(1000 * ball.vertices), kind, level=0.2, rng=np.random.default_rng(6))
        np.testing.assert_allclose(large, 1000 * one, rtol=1e-9, atol=1e-9)


def test_unknown_kinds_and_negative_levels_are_refused(ball):
    rng = np.random.default_rng(7)
    with pytest.raises(ValueError, match=r"'salt'.*impulsive"):
        displacements(ball, "salt", level=0.1, rng=rng)
    with pytest.raises(ValueError, match=r"-0\.1"):
        displacements(ball, "normal", level=-0.1, rng=rng)


def test_a_closed_surface_is_seen_from_a_direction_that_is_drawn(ball):
    flipped = Mesh(ball.vertices, np.roll(ball.faces[::-1], 1, axis=1))
    one, two = (displacements(mesh, "sensor", level=0.2, rng=np.random.default_rng(3)) for mesh in (ball, flipped))
    np.testing.assert_allclose(one, two, atol=1e-12)
    other = displacements(ball, "sensor", level=0.2, rng=np.random.default_rng(4))
    towards = [moves[np.abs(moves).sum(axis=1).argmax()] for moves in (one, other)]
    assert abs(np.dot(*(v / np.linalg.norm(v) for v in towards))) < 0.99


@pytest.mark.parametrize("seed", range(6))
def test_correlated_noise_has_its_deviation_and_is_alike_in_neighbours(seed):
    mesh = icosphere(5)
    rng = np.random.default_rng(seed)
    moves = displacements(mesh, "correlated", level=0.3, rng=rng) / mesh.mean_edge_length
    along = np.einsum("ij,ij->i", moves, mesh.vertex_normals)
    size = np.sqrt(np.mean(np.sum(moves**2, axis=1)))
    assert 0.25 < size < 0.3 * np.sqrt(3) * 1.25
    a, b = mesh.topology.edges.T
    assert np.corrcoef(along[a], along[b])[0, 1] > 0.2
