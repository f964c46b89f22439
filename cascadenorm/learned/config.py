"""Training settings, in Python and as TOML.

This module does not import torch, so that mistakes in settings are reported at once.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, is_dataclass, replace
from os import PathLike
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from cascadenorm.data_gen import DatasetConfig
from cascadenorm.errors import ConfigError as ConfigError
from cascadenorm.learned.stage import Stage

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

Config = TypeVar("Config")


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Training settings of one network."""

    hidden: tuple[int, ...] = (128, 64)  # widths of the hidden layers
    epochs: int = 5  # at most
    patience: int = 5  # epochs without a better validation loss before training stops
    batch: int = 1024  # faces in a batch
    learning_rate: float = 2e-3  # of AdamW, with a cosine schedule
    weight_decay: float = 1e-3  # of AdamW
    clip: float = 1.0  # norm to which gradients are clipped

    def __post_init__(self) -> None:
        if not self.hidden or min(self.hidden) < 1:
            raise ConfigError(f"fit.hidden is {list(self.hidden)}; it must be the width of one layer or more")
        for name in ("epochs", "patience", "batch", "learning_rate", "clip"):
            if not getattr(self, name) > 0:
                raise ConfigError(f"fit.{name} is {getattr(self, name)}; it must be above 0")
        if not self.weight_decay >= 0:
            raise ConfigError(f"fit.weight_decay is {self.weight_decay}; it must be at least 0")


VERTEX_STAGES = (
    Stage(descriptor="iterated-32+smoothed", meshes=4000, weighting="cotangent", sweeps=10),
    Stage(descriptor="iterated-16+smoothed", pairs=64, epochs=10, weighting="cotangent", sweeps=10),
    Stage(descriptor="iterated-16+smoothed", pairs=64, epochs=10, weighting="cotangent"),
)
VERTEX_DATA = DatasetConfig(
    count=8000,
    families=(
        "assembly", "bracket", "wheel", "turned", "plate", "polyhedron", "engraved", "fan", "creature", "statue",
        "mounted", "bust", "bumpy", "smooth", "rock", "low_poly", "decimated", "decimated", "subdivided", "structured",
        "cad_tessellation",
    ),
    min_faces=2000,
    max_faces=20000,
    noise_kinds=(
        "normal", "normal", "normal", "gaussian", "gaussian", "uniform", "impulsive", "impulsive", "varying", "mixed",
        "correlated", "correlated", "quantised", "none", "none", "none",
    ),
    relief=0.27,
    min_level=0.02,
    max_level=0.7,
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Settings that determine the result of a training. The defaults are those of `configs/vertex.toml`.

    Parameters
    ----------
    seed
        Seed for drawing faces, clustering and initialising networks. `data.seed` is the seed of shapes and noise.
    faces_per_mesh
        Number of faces drawn from each mesh, without repetition.
    clusters
        Number of networks in each stage.
    context
        Number of principal components of the features that are averaged around a face; 0 disables context features.
    stages
        Stages, in order.
    fit
        Settings of each network.
    data
        Settings of the noisy/clean pairs.
    """

    seed: int = 0
    faces_per_mesh: int = 500
    clusters: int = 1
    context: int = 24
    stages: tuple[Stage, ...] = VERTEX_STAGES
    fit: Fit = field(default_factory=Fit)
    data: DatasetConfig = field(default_factory=lambda: VERTEX_DATA)

    def __post_init__(self) -> None:
        for name, least in (("faces_per_mesh", 1), ("clusters", 1), ("context", 0), ("seed", 0)):
            if getattr(self, name) < least:
                raise ConfigError(f"{name} is {getattr(self, name)}; it must be at least {least}")
        if not self.stages:
            raise ConfigError("stages is empty; a cascade has one stage or more")


QUICK = TrainConfig(faces_per_mesh=2500, fit=Fit(epochs=10), data=replace(VERTEX_DATA, count=40))
"""A training of about a minute that tests the setup. Its results are far from the best."""


def read_config(path: str | PathLike[str]) -> TrainConfig:
    """Read settings from a TOML file. Missing settings keep their defaults.

    Parameters
    ----------
    path
        TOML file.

    Returns
    -------
    The settings of a training.

    Raises
    ------
    ConfigError
        The file is missing or not valid TOML, has an unknown key, or a value of the wrong type.
    """
    try:
        with open(path, "rb") as file:
            table = tomllib.load(file)
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}") from None
    except ValueError as error:  # also of numbers with too many digits
        raise ConfigError(f"{path} is not TOML: {error}") from None
    try:
        return settings_from(TrainConfig(), table)
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from None


def settings_from(base: Config, table: Mapping[str, Any], *, prefix: str = "") -> Config:
    """Return settings, a dataclass, with changes from nested tables.

    Raises ConfigError if a key is unknown, or a value has the wrong type.
    """
    return replace(base, **_changes(type(base), base, table, prefix))  # type: ignore[type-var]  # always a dataclass


def _changes(kind: Any, base: Any, table: Any, prefix: str) -> dict[str, Any]:
    """Return the fields of a dataclass that a table sets; `base` has their current values, if there are any."""
    if not isinstance(table, Mapping):
        raise ConfigError(f"{prefix[:-1]} is {table!r}; it must be a table")
    hints = get_type_hints(kind)
    if unknown := [key for key in table if key not in hints]:
        raise ConfigError(
            f"there is no setting {prefix}{unknown[0]}; {prefix[:-1] or 'the'} settings are {', '.join(hints)}"
        )
    return {key: _value(hints[key], getattr(base, key, None), value, prefix + key) for key, value in table.items()}


def _value(kind: Any, default: Any, value: Any, name: str) -> Any:
    if is_dataclass(default):
        return settings_from(default, value, prefix=f"{name}.")
    if kind is Stage:
        changes = _changes(Stage, None, value, f"{name}.")
        if "descriptor" not in changes:
            raise ConfigError(f"{name} has no descriptor")
        return Stage(**changes)
    if get_origin(kind) is tuple:
        if not isinstance(value, list):
            raise ConfigError(f"{name} is {value!r}; it must be a list")
        return tuple(_value(get_args(kind)[0], None, item, name) for item in value)
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if kind in (int, float, str, bool) and type(value) is not kind:
        raise ConfigError(f"{name} is {value!r}; it must be of type {kind.__name__}")
    return value
