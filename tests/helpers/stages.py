"""Stages of cascades with random weights."""

import numpy as np

from cascadenorm.learned.descriptors import DESCRIPTORS
from cascadenorm.learned.features import CONTEXT_STEPS, FeatureScaler, all_pairs
from cascadenorm.learned.regression import Regression
from cascadenorm.learned.stage import Stage


def stage_settings(descriptor: str, *, activation: str = "tanh") -> Stage:
    """Settings of a stage."""
    return Stage(descriptor=descriptor, activation=activation, foldovers="ignore")


def random_regression(descriptor: str, *, seed: int = 0, activation: str = "tanh") -> Regression:
    """A stage with random weights."""
    rng = np.random.default_rng(seed)
    k, hidden, clusters, p = DESCRIPTORS[descriptor].size, 7, 3, 5
    d, context = k * (k - 1) // 2, p * (len(CONTEXT_STEPS) + 1) + 1

    def random(*shape: int) -> np.ndarray:
        return rng.normal(size=shape).astype(np.float32)

    return Regression(
        settings=stage_settings(descriptor, activation=activation),
        scaler=FeatureScaler(
            pairs=all_pairs(k), mean=random(d), scale=np.full(d, 0.3, np.float32), projection=random(d, p) / d,
            context_mean=random(context), context_scale=np.ones(context, np.float32),
        ),
        centers=random(clusters, d + context),
        layers=(
            (random(clusters, d + context, hidden) / 20, random(clusters, hidden)),
            (random(clusters, hidden, 5), random(clusters, 5)),
            (random(clusters, 5, k), random(clusters, k)),
        ),
    )  # fmt: skip
