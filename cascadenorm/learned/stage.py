"""Settings of one stage of a cascade, as in configurations and weights files."""

from dataclasses import dataclass
from typing import Literal, get_args

from cascadenorm.baselines.vertex_update import Foldovers, Weighting
from cascadenorm.errors import ConfigError
from cascadenorm.learned.descriptors import DESCRIPTORS

Activation = Literal["silu", "tanh"]


@dataclass(frozen=True, kw_only=True)
class Stage:
    """Settings of one stage of a cascade: a table `[[stages]]` of a training configuration.

    Parameters
    ----------
    descriptor
        Filtered normals that the stage reads, a name in DESCRIPTORS.
    activation
        Activation of the hidden layers of its networks, "silu" or "tanh".
    weighting, foldovers, sweeps
        Settings of the vertex update after the stage, see `recover_vertices`.
    """

    descriptor: str
    activation: Activation = "silu"
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
        if self.sweeps < 0:
            raise ConfigError(f"sweeps is {self.sweeps}; it must be at least 0")
