"""Checkpoints from which an interrupted training resumes."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

from numpy.typing import NDArray
from safetensors import numpy as safetensors

from cascadenorm.data_gen import Pair
from cascadenorm.learned.cascade import CASCADE_FORMATS
from cascadenorm.learned.config import ConfigError, TrainConfig
from cascadenorm.learned.regression import Regression
from cascadenorm.learned.training.launch import is_main


def versions() -> dict[str, str]:
    """Return the versions of the packages that the result of a training depends on."""
    return {name: version(name) for name in ("cascadenorm", "numpy", "scikit-learn", "torch")}


def claim(checkpoint: Path, config: TrainConfig, own: Sequence[Pair], first: Regression | None = None) -> None:
    """Create the folder for this config, these pairs, first stage and version, or check that it belongs to them."""
    checkpoint.mkdir(parents=True, exist_ok=True)
    digest = sha256()
    for pair in own:
        for array in (pair.noisy.vertices, pair.clean.vertices, pair.clean.faces):
            digest.update(array.tobytes())
    for _, array in sorted(first.arrays().items()) if first else ():
        digest.update(array.tobytes())
    note = checkpoint / "config.json"
    made_with = {"format": CASCADE_FORMATS[0], **versions()}
    text = json.dumps(asdict(config) | {"own": digest.hexdigest(), "made_with": made_with}, indent=1, sort_keys=True)
    if note.exists() and note.read_text(encoding="utf-8") != text:
        raise ConfigError(
            f"{checkpoint} holds a training with other settings or another version: remove it, or name another folder"
        )
    _write_whole(note, text.encode())


def write_shared_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays that all processes have. Only rank 0 writes."""
    if is_main():
        write_arrays(path, arrays)


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays that only this process has."""
    _write_whole(path, safetensors.save(dict(arrays)))  # a full disk raises OSError, as elsewhere


def _write_whole(path: Path, content: bytes) -> None:
    """Write atomically, so that an existing file is complete."""
    unfinished = path.with_suffix(".partial")
    unfinished.write_bytes(content)
    os.replace(unfinished, path)


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """Return the stored arrays, or an empty dictionary if there is no file."""
    return safetensors.load_file(path) if path.exists() else {}
