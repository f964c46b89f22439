"""Settings of a training, in Python and as TOML; without torch, so that a mistake in them is told at once."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from os import PathLike
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from cascadenorm.baselines.vertex_update import Foldovers, Weighting
from cascadenorm.data_gen import DatasetConfig
from cascadenorm.errors import ConfigError as ConfigError
from cascadenorm.learned.descriptors import DESCRIPTORS, Neighborhood
from cascadenorm.learned.stage_settings import ACTIVATIONS, CHOICES, StageSettings

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

Settings = TypeVar("Settings")


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Settings of the training of one network.

    Parameters
    ----------
    hidden
        Widths of the hidden layers.
    activation
        Of the hidden layers, "tanh" or "silu".
    epochs
        Passes over the training part at most.
    patience
        Passes without a better validation loss before it stops.
    batch
        Faces to a step.
    learning_rate, weight_decay, clip
        Of AdamW, with a cosine schedule and gradients clipped to this norm.
    """

    hidden: tuple[int, ...] = (160,)
    activation: str = "tanh"
    epochs: int = 20
    patience: int = 5
    batch: int = 1024
    learning_rate: float = 2e-3
    weight_decay: float = 1e-3
    clip: float = 1.0

    def __post_init__(self) -> None:
        if not self.hidden or min(self.hidden) < 1:
            raise ConfigError(f"fit.hidden is {list(self.hidden)}; it must be the width of one layer or more")
        if self.activation not in ACTIVATIONS:
            raise ConfigError(f"fit.activation is {self.activation!r}; it must be one of {', '.join(ACTIVATIONS)}")
        for name in ("epochs", "patience", "batch", "learning_rate", "clip"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"fit.{name} is {getattr(self, name)}; it must be above 0")
        if not self.weight_decay >= 0:
            raise ConfigError(f"fit.weight_decay is {self.weight_decay}; it must be at least 0")


DATA = DatasetConfig(
    count=600,
    families=(
        "assembly", "bracket", "wheel", "turned", "plate", "polyhedron", "engraved", "fan", "creature", "statue",
        "mounted", "bust", "bumpy", "smooth", "rock", "machined_piece", "grown_piece", "view", "fused",
    ),
    min_faces=2000,
    max_faces=20000,
    noise_kinds=(
        "normal", "normal", "normal", "gaussian", "gaussian", "uniform", "impulsive", "impulsive", "varying", "mixed",
        "sensor",
    ),
    min_level=0.03,
    max_level=0.7,
)  # fmt: skip
"""What a training without settings is trained on."""


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Everything that decides what a training makes.

    Parameters
    ----------
    seed
        Of the drawn faces, the clusters and the networks; that of the shapes and noise is data.seed.
    faces_per_mesh
        Drawn from each mesh, without repetition.
    clusters
        Networks in each stage.
    descriptors
        What each stage reads, names in DESCRIPTORS; as many stages as entries.
    neighborhood
        Which faces the filters B and G add, "rings" or "distance" as published.
    context
        Principal directions of the features that are averaged around a face; 0 leaves context features out.
    last_weighting
        Of the vertex update after the last stage, "angles" or "heights" as published, which the other stages have.
    foldovers
        In the vertex update, "avoid" or "ignore" as published.
    sweeps
        Of the vertex update after each stage but the last, which has 20.
    fit
        Settings of each network.
    data
        The noisy/clean pairs.
    """

    seed: int = 0
    faces_per_mesh: int = 2500
    clusters: int = 4
    descriptors: tuple[str, ...] = ("n+B+G", "n+B", "n+B")
    neighborhood: Neighborhood = "rings"
    context: int = 24
    last_weighting: Weighting = "angles"
    foldovers: Foldovers = "avoid"
    sweeps: int = StageSettings.sweeps
    fit: Fit = field(default_factory=Fit)
    data: DatasetConfig = field(default_factory=lambda: DATA)

    def __post_init__(self) -> None:
        for name, least in (("faces_per_mesh", 1), ("clusters", 1), ("context", 0), ("sweeps", 0), ("seed", 0)):
            if getattr(self, name) < least:
                raise ConfigError(f"{name} is {getattr(self, name)}; it must be at least {least}")
        if not self.descriptors or not set(self.descriptors) <= set(DESCRIPTORS):
            raise ConfigError(f"descriptors are {list(self.descriptors)}; each must be one of {', '.join(DESCRIPTORS)}")
        for name in ("neighborhood", "last_weighting", "foldovers"):
            known = CHOICES[name.removeprefix("last_")]
            if getattr(self, name) not in known:
                raise ConfigError(f"{name} is {getattr(self, name)!r}; it must be one of {', '.join(known)}")

    @property
    def stages(self) -> tuple[StageSettings, ...]:
        """Return what each stage does."""
        last = len(self.descriptors) - 1
        return tuple(
            StageSettings(
                descriptor=descriptor,
                neighborhood=self.neighborhood,
                activation=self.fit.activation,
                weighting=self.last_weighting if number == last else "heights",
                foldovers=self.foldovers,
                sweeps=StageSettings.sweeps if number == last else self.sweeps,
            )
            for number, descriptor in enumerate(self.descriptors)
        )


QUICK = TrainConfig(fit=Fit(epochs=10), data=replace(DATA, count=40))
"""A training of about a minute, to see that everything works; far from the best result."""


def read_config(path: str | PathLike[str]) -> TrainConfig:
    """Read settings from a TOML file; what it leaves out keeps its default.

    Raises
    ------
    ConfigError
        The file is missing or no TOML, has a key that does not exist, or a value of the wrong type.
    """
    try:
        with open(path, "rb") as file:
            table = tomllib.load(file)
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not TOML: {error}") from None
    try:
        return settings_from(TrainConfig(), table)
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from None


def settings_from(base: Settings, table: Mapping[str, Any], *, prefix: str = "") -> Settings:
    """Change settings, a dataclass, by nested tables.

    Raises
    ------
    ConfigError
        An unknown key, or a value of the wrong type.
    """
    hints = get_type_hints(type(base))
    known = [f.name for f in fields(base)]  # type: ignore[arg-type]  # always a dataclass
    unknown = [key for key in table if key not in known]
    if unknown:
        raise ConfigError(
            f"there is no setting {prefix}{unknown[0]}; {prefix[:-1] or 'the'} settings are {', '.join(known)}"
        )
    changes = {key: _value(hints[key], getattr(base, key), value, prefix + key) for key, value in table.items()}
    return replace(base, **changes)  # type: ignore[type-var]


def _value(kind: Any, default: Any, value: Any, name: str) -> Any:
    if is_dataclass(default) and not isinstance(default, type):
        if not isinstance(value, Mapping):
            raise ConfigError(f"{name} is {value!r}; it must be a table: [{name}]")
        return settings_from(default, value, prefix=f"{name}.")
    if get_origin(kind) is tuple:
        if not isinstance(value, list):
            raise ConfigError(f"{name} is {value!r}; it must be a list")
        return tuple(_value(get_args(kind)[0], None, item, name) for item in value)
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if kind in (int, float, str, bool) and type(value) is not kind:
        raise ConfigError(f"{name} is {value!r}; it must be of type {kind.__name__}")
    return value
