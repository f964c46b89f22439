"""The training of a network lowers its loss, stops at its best pass, and is refused where it diverges."""

import numpy as np
import pytest
import torch
from shapes import cube, icosphere, noisy

from cascadenorm.learned.config import ConfigError, Fit
from cascadenorm.learned.descriptors import bilateral_descriptor
from cascadenorm.learned.features import FeatureScaler, all_pairs
from cascadenorm.learned.packed_normals import unpacked
from cascadenorm.learned.regression import stage_stack
from cascadenorm.learned.stage import Stage
from cascadenorm.learned.training.network_training import (
    TrainingFaces,
    angle_sum,
    chordal_distance,
    torch_features,
    train_network,
)


def to_learn_from(clean, level) -> tuple[TrainingFaces, FeatureScaler]:
    """All faces of a mesh with noise, and a scaler that leaves their features as they are."""
    stack = bilateral_descriptor(noisy(clean, level))
    pairs = all_pairs(stack.shape[1])
    inputs = len(pairs)
    zero, one, none = np.zeros(inputs, np.float32), np.ones(inputs, np.float32), np.zeros(0, np.float32)
    scaler = FeatureScaler(
        pairs=pairs,
        mean=zero,
        scale=one,
        projection=np.zeros((inputs, 0), np.float32),
        context_mean=none,
        context_scale=none,
    )
    context = np.zeros((len(stack), 0), np.float32)
    return TrainingFaces(*map(torch.from_numpy, (stack, context, clean.face_normals.astype(np.float32)))), scaler


def test_training_lowers_the_loss():
    faces, scaler = to_learn_from(cube(10), 0.25)
    losses: list[float] = []
    rows, fit = np.arange(len(faces.truth)), Fit(epochs=8, batch=64)
    train_network(faces, rows, scaler, fit, "tanh", seed=0, log=lambda *said: losses.append(said[2]))
    assert losses[-1] < 0.95 * losses[0]


def test_features_to_learn_from_are_those_at_run_time():
    mesh = noisy(icosphere(2), 0.3)
    packed = stage_stack(Stage(descriptor="B"), mesh, mesh)
    stack, rng = unpacked(packed), np.random.default_rng(0)
    pairs = all_pairs(10)[::2]
    mean, scale, context_mean, context_scale = (rng.uniform(0.5, 2, n).astype(np.float32) for n in (23, 23, 11, 11))
    scaler = FeatureScaler(
        pairs=pairs, mean=mean, scale=scale, projection=rng.normal(size=(23, 2)).astype(np.float32),
        context_mean=context_mean, context_scale=context_scale,
    )  # fmt: skip
    context = scaler.context(packed, mesh).of()
    learned = torch_features(scaler, torch.device("cpu"))(torch.from_numpy(stack), torch.from_numpy(context))
    np.testing.assert_allclose(learned, scaler.features(stack, context), rtol=0, atol=1e-5)


def test_chord_is_twice_the_sine_of_half_the_angle():
    angle = torch.tensor([0.2, 1.0])
    turned = torch.stack([torch.cos(angle), torch.sin(angle), 0 * angle], dim=1)
    found = chordal_distance(turned, torch.tensor([[1.0, 0, 0]]).expand(2, 3))
    np.testing.assert_allclose(found, [2 * np.sin(0.1), 2 * np.sin(0.5)], rtol=1e-4)
    assert angle_sum(found) == pytest.approx(np.degrees(1.2), rel=1e-4)


def test_early_stopping_returns_the_best_pass():
    faces, scaler = to_learn_from(icosphere(2), 0.3)
    seen: list[float] = []
    rows, fit = np.arange(len(faces.truth)), Fit(epochs=200, batch=16, hidden=(64,), patience=3)
    train_network(faces, rows, scaler, fit, "tanh", seed=0, log=lambda *said: seen.append(said[2]))
    assert len(seen) < 200
    assert np.argmin(seen) == len(seen) - 1 - fit.patience


def test_a_training_that_diverges_is_refused():
    faces, scaler = to_learn_from(cube(4), 0.25)
    with pytest.raises(ConfigError, match="the training diverged"):
        fit = Fit(epochs=2, batch=16, learning_rate=1e30)
        train_network(faces, np.arange(len(faces.truth)), scaler, fit, "tanh", seed=0)
