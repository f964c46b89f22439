"""What a stage of a cascade reads and how the vertices follow its normals: names, stored in the weights."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from cascadenorm.baselines.vertex_update import Foldovers, Weighting
from cascadenorm.learned.descriptors import DESCRIPTORS, Neighborhood


def _silu(x: NDArray[np.float32]) -> NDArray[np.float32]:
    """x / (1 + e^-x) = x/2 (1 + tanh x/2), in place of x."""
    x *= 0.5
    out = np.tanh(x)
    out += 1
    out *= x
    return out


ACTIVATIONS: dict[str, Callable[[NDArray[np.float32]], NDArray[np.float32]]] = {
    "tanh": lambda x: np.tanh(x, out=x),
    "silu": _silu,
}
"""What is between the layers of a network, by the name that settings and weights use; they overwrite what they take."""

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
    descriptor : which filtered normals it reads, a name in DESCRIPTORS
    neighborhood : which faces the filters B and G add, "distance" or "rings"; the others add one ring
    activation : between the layers of its networks, a name in ACTIVATIONS
    weighting, foldovers : of the vertex update, as `recover_vertices` takes them
    """

    descriptor: str
    neighborhood: Neighborhood
    activation: str
    weighting: Weighting
    foldovers: Foldovers
