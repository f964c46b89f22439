"""Settings of one stage of a cascade, as in configurations and weights files."""

from dataclasses import dataclass
from typing import Literal, get_args

from cascadenorm.baselines.vertex_update import Foldovers, Weighting
from cascadenorm.errors import ConfigError
from cascadenorm.learned.descriptors import DESCRIPTORS

Activation = Literal["silu", "tanh"]


@dataclass(frozen=True, kw_only=True)
class Stage:
    """Settings of one stage of a cascade: a table `[[stages]]` of a training configuration."""

    descriptor: str  # filtered normals that the stage reads, a name in DESCRIPTORS
    pairs: int = 0  # pairs of filtered normals whose angles the networks read; 0 selects all pairs
    activation: Activation = "silu"  # of the hidden layers of its networks
    # generated meshes that it is trained on, the first ones; 0 selects all. Given pairs are always used
    meshes: int = 0
    epochs: int = 0  # of its training, at most; 0 selects `fit.epochs`
    # this and the following: settings of the vertex update after the stage, see `recover_vertices`
    weighting: Weighting = "uniform"
    foldovers: Foldovers = "avoid"
    sweeps: int = 20

    def __post_init__(self) -> None:
        for name, known in (
            ("descriptor", DESCRIPTORS),
            ("activation", get_args(Activation)),
            ("weighting", get_args(Weighting)),
            ("foldovers", get_args(Foldovers)),
        ):
            if getattr(self, name) not in known:
                raise ConfigError(f"{name} is {getattr(self, name)!r}; it must be one of {', '.join(known)}")
        for name in ("pairs", "meshes", "epochs", "sweeps"):
            if getattr(self, name) < 0:
                raise ConfigError(f"{name} is {getattr(self, name)}; it must be at least 0")
