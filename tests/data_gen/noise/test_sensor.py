"""Depth cameras and laser scanners err along a direction of view that is drawn, by their level."""

import numpy as np
import pytest
from shapes import cube, grid

from cascadenorm.data_gen import displacements
from cascadenorm.data_gen.noise.sensor import camera_errors
from cascadenorm.mesh import Mesh


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


def test_a_closed_surface_is_seen_from_a_direction_that_is_drawn(ball):
    flipped = Mesh(ball.vertices, np.roll(ball.faces[::-1], 1, axis=1))
    one, two = (displacements(mesh, "sensor", level=0.2, rng=np.random.default_rng(3)) for mesh in (ball, flipped))
    np.testing.assert_allclose(one, two, atol=1e-12)
    other = displacements(ball, "sensor", level=0.2, rng=np.random.default_rng(4))
    towards = [moves[np.abs(moves).sum(axis=1).argmax()] for moves in (one, other)]
    assert abs(np.dot(*(v / np.linalg.norm(v) for v in towards))) < 0.99
