"""Check the settings of a batch and compute their digest."""

import hashlib
import json
import os
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from cascadenorm.api.api import check_weights, weights_digest
from cascadenorm.batch.work import BatchSettings
from cascadenorm.errors import ParameterError
from cascadenorm.execution.progress import Listener
from cascadenorm.io.digests import file_digest, source_digest
from cascadenorm.learned.methods import SHIPPED
from cascadenorm.registry import find
from cascadenorm.registry.controls import checked_controls
from cascadenorm.version import __version__

NO_RESULT = ("threads", "progress")
"""Controls that do not affect a result; they apply to the whole batch."""


def batch_settings(
    method: str, parameters: Mapping[str, Any], controls: Mapping[str, Any], format: str | None, *, force: bool
) -> tuple[BatchSettings, int | None, Listener | None]:
    """Check the settings; return them, the number of threads and the listener. Raises ParameterError."""
    every, values = checked_controls(controls), find(method).with_defaults(parameters)
    given = {name: value for name, value in every.items() if name not in NO_RESULT}
    parts = [__version__, source_digest(find(method).function), method, values, given, format]
    parts = [json.dumps(parts, sort_keys=True, default=_as_text), *map(_content, given.values())]
    if method in SHIPPED:
        if not isinstance(model := values["model"], str | PathLike | None):
            raise ParameterError(
                f"is a {type(model).__name__}; it must be the path of a weights file, which each process reads",
                parameter="model",
            )
        check_weights(method, values)  # fail early: invalid weights would fail for every file
        parts.append(weights_digest(method, values))
    key = hashlib.sha256(json.dumps(parts).encode()).hexdigest()
    return BatchSettings(method, dict(parameters), given, force, key), every["threads"], every["progress"]


def _as_text(value: Any) -> str:
    return hashlib.sha256(value.tobytes()).hexdigest() if isinstance(value, np.ndarray) else str(value)


def _content(value: Any) -> str:
    """Return the digest of the file that a control names, such as a mask; empty for other values."""
    named = isinstance(value, str | PathLike) and os.path.isfile(value)  # also of a list that is too long for a name
    return file_digest(Path(value)) if named else ""
