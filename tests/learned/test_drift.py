"""Slowly varying displacements, the drift, are removed; those that change from vertex to vertex stay."""

import numpy as np
import pytest
from shapes import icosphere

from cascadenorm.learned.methods import without_drift

BALL = icosphere(5)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_slow_waves_are_taken_back(degree):
    """The lowest spherical harmonics, over sixty edges and more."""
    wave = 0.01 * [np.ones(len(BALL.vertices)), BALL.vertices[:, 2], 3 * BALL.vertices[:, 2] ** 2 - 1][degree]
    found = without_drift(BALL, BALL.vertices * (1 + wave)[:, None])
    left = np.linalg.norm(found, axis=1) - 1
    assert rms(left) < 0.15 * rms(wave)


def test_noise_that_was_taken_away_stays_away():
    noise = 0.02 * np.random.default_rng(0).normal(size=len(BALL.vertices))
    noisy = BALL.moved(BALL.vertices * (1 + noise)[:, None])
    found = without_drift(noisy, BALL.vertices)
    assert rms(np.linalg.norm(found, axis=1) - 1) < 0.1 * rms(noise)


def test_nothing_happens_to_what_has_not_moved():
    assert without_drift(BALL, BALL.vertices).tobytes() == BALL.vertices.tobytes()


def test_vertices_that_have_not_moved_stay_where_the_rest_of_a_component_drifts():
    low = BALL.vertices[:, 2] < 0
    found = without_drift(BALL, np.where(low[:, None], BALL.vertices, 1.01 * BALL.vertices))
    assert found[low].tobytes() == BALL.vertices[low].tobytes()
    left = np.linalg.norm(found[BALL.vertices[:, 2] > 0.5], axis=1) - 1
    assert rms(left) < 0.15 * 0.01


def test_it_turns_and_scales_with_the_mesh():
    rng = np.random.default_rng(1)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    moved = BALL.vertices + 0.05 * rng.normal(size=BALL.vertices.shape)
    there = without_drift(BALL.moved(3 * BALL.vertices @ turn.T), 3 * moved @ turn.T)
    np.testing.assert_allclose(there, 3 * without_drift(BALL, moved) @ turn.T, atol=1e-12)
