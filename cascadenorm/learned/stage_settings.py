"""What a stage of a cascade reads and how the vertices follow its normals: names, stored in the weights."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import get_args

import numpy as np

from cascadenorm.baselines.vertex_update import Foldovers, Weighting
from cascadenorm.compute.elementary import expf
from cascadenorm.learned.descriptors import DESCRIPTORS, Neighborhood
from cascadenorm.mesh import Floats32, kernel


def _tanh(x: Floats32, bias: Floats32) -> None:
    x += bias
    np.tanh(x, out=x)


@kernel
def _silu(x: Floats32, bias: Floats32) -> None:
    """y / (1 + e^-y), y = x + bias; in half of the time of numpy's steps."""
    for i in range(len(x)):
        for j in range(x.shape[1]):
            y = x[i, j] + bias[j]
            x[i, j] = y / (np.float32(1) + expf(-y))


ACTIVATIONS: dict[str, Callable[[Floats32, Floats32], None]] = {"tanh": _tanh, "silu": _silu}
"""What is between the layers of a network, by the name that settings and weights use; x and bias, in place of x."""

CHOICES: dict[str, Collection[str]] = {
    "descriptor": DESCRIPTORS,
    "neighborhood": get_args(Neighborhood),
    "activation": ACTIVATIONS,
    "weighting": get_args(Weighting),
    "foldovers": get_args(Foldovers),
}
"""The values that a setting may have."""


@dataclass(frozen=True, kw_only=True)
class StageSettings:
    """What a stage does, beside its arrays.

    Parameters
    ----------
    descriptor
        Which filtered normals it reads, a name in DESCRIPTORS.
    neighborhood
        Which faces the filters B and G add, "distance" or "rings"; the others add one ring.
    activation
        Between the layers of its networks, a name in ACTIVATIONS.
    weighting, foldovers, sweeps
        Of the vertex update, as `recover_vertices` takes them.
    """

    descriptor: str
    neighborhood: Neighborhood
    activation: str
    weighting: Weighting
    foldovers: Foldovers
    sweeps: int = 20
