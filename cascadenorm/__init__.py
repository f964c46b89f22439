"""Triangle-mesh denoising by cascaded normal regression, beside the classical methods.

import cascadenorm as cn
vertices = cn.denoise(vertices, faces)
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cascadenorm.api import Report, compare, denoise, denoise_file, methods
    from cascadenorm.controls import DenoiseError
    from cascadenorm.evaluation import evaluate
    from cascadenorm.io import OutputError, ReadError, from_arrays, read, write
    from cascadenorm.mesh import Mesh, MeshError
    from cascadenorm.metrics import Measures
    from cascadenorm.registry import ParameterError

__version__ = "0.1.0"

_HOMES = {  # loaded when first used: the command line starts without numpy and numba
    "DenoiseError": "controls",
    "Measures": "metrics",
    "Mesh": "mesh",
    "MeshError": "mesh",
    "OutputError": "io",
    "ParameterError": "registry",
    "ReadError": "io",
    "Report": "api",
    "compare": "api",
    "denoise": "api",
    "denoise_file": "api",
    "evaluate": "evaluation",
    "from_arrays": "io",
    "methods": "api",
    "read": "io",
    "write": "io",
}

__all__ = [
    "DenoiseError",
    "Measures",
    "Mesh",
    "MeshError",
    "OutputError",
    "ParameterError",
    "ReadError",
    "Report",
    "compare",
    "denoise",
    "denoise_file",
    "evaluate",
    "from_arrays",
    "methods",
    "read",
    "write",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'cascadenorm' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"cascadenorm.{_HOMES[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
