"""Weights files: arrays with a JSON header, stored as safetensors.

Reading such a file executes no code.
"""

import json
from collections.abc import Mapping
from os import PathLike, fspath
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from cascadenorm.registry import ParameterError

Arrays = dict[str, NDArray[Any]]


def packed(header: Mapping[str, Any], tensors: Arrays) -> bytes:
    """Return the content of a weights file. Equal contents have equal bytes."""
    arrays = {name: np.ascontiguousarray(array) for name, array in tensors.items()}
    return save(arrays, {"cascadenorm": json.dumps(header, sort_keys=True)})


def unpacked(path: str | PathLike[str]) -> tuple[dict[str, Any], Arrays]:
    """Read the header and the arrays of a weights file. The arrays are read-only, since callers share the model.

    Raises ParameterError if the file is missing, cannot be read, or is not a weights file.
    """
    try:
        with open(path, "rb"), safe_open(fspath(path), framework="numpy") as file:  # open explains what is no file
            header = json.loads((file.metadata() or {})["cascadenorm"])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a mapping
    except OSError as error:
        raise ParameterError(f"the weights {fspath(path)} cannot be read: {error.strerror or error}") from None
    except (SafetensorError, KeyError, ValueError):
        raise ParameterError(f"{fspath(path)} is not a weights file: train one with `cascadenorm train`") from None
    for tensor in tensors.values():
        tensor.flags.writeable = False
    return header, tensors
