"""Triangle-mesh denoising by cascaded normal regression, beside the classical methods.

import cascadenorm as cn
vertices = cn.denoise(vertices, faces)
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cascadenorm import display
from cascadenorm.version import __version__ as __version__

if TYPE_CHECKING:
    from cascadenorm.api.any_mesh import (
        farthest_points,
        fast_harmonics,
        fill_holes,
        geodesic_distances,
        manifold_harmonics,
        shape_dna,
        write,
    )
    from cascadenorm.api.api import Whole, compare, denoise, denoise_file, methods
    from cascadenorm.api.inspection import Inspection, inspect
    from cascadenorm.api.models import Denoiser, train
    from cascadenorm.api.opened_files import DenoisingSummary
    from cascadenorm.api.regions import denoise_region_files, denoise_regions
    from cascadenorm.api.spectra import Spectrum, spectrum
    from cascadenorm.batch.batch import denoise_files
    from cascadenorm.controls import Controls
    from cascadenorm.errors import (
        CascadenormError,
        ConfigError,
        DenoiseError,
        MeshError,
        MissingDependencyError,
        OutputError,
        ParameterError,
        ReadError,
        WorkerError,
    )
    from cascadenorm.evaluation.harness import evaluate
    from cascadenorm.frontends.progress_bars import progress_bar
    from cascadenorm.geometry.metrics import Measures
    from cascadenorm.io import from_arrays, read
    from cascadenorm.learned.config import TrainConfig, read_config
    from cascadenorm.mesh import Mesh
    from cascadenorm.reports import report
    from cascadenorm.reports.notebook import view

if (_checkout := Path(__file__).parents[1]).joinpath("baselines", "__init__.py").exists():
    # In a checkout `baselines/` and `data_gen/` lie beside the package instead of in it.
    __path__.append(str(_checkout))

_HOMES = {  # loaded when first used: the command line starts without numpy and numba
    "CascadenormError": "errors",
    "ConfigError": "errors",
    "Controls": "controls",
    "DenoiseError": "errors",
    "Denoiser": "api.models",
    "DenoisingSummary": "api.opened_files",
    "Inspection": "api.inspection",
    "Measures": "geometry.metrics",
    "Mesh": "mesh",
    "MeshError": "errors",
    "MissingDependencyError": "errors",
    "OutputError": "errors",
    "ParameterError": "errors",
    "ReadError": "errors",
    "Spectrum": "api.spectra",
    "TrainConfig": "learned.config",
    "Whole": "api.api",
    "WorkerError": "errors",
    "compare": "api.api",
    "denoise": "api.api",
    "denoise_file": "api.api",
    "denoise_files": "batch.batch",
    "denoise_region_files": "api.regions",
    "denoise_regions": "api.regions",
    "evaluate": "evaluation.harness",
    "farthest_points": "api.any_mesh",
    "fast_harmonics": "api.any_mesh",
    "fill_holes": "api.any_mesh",
    "from_arrays": "io",
    "geodesic_distances": "api.any_mesh",
    "inspect": "api.inspection",
    "manifold_harmonics": "api.any_mesh",
    "methods": "api.api",
    "progress_bar": "frontends.progress_bars",
    "read": "io",
    "read_config": "learned.config",
    "report": "reports",
    "shape_dna": "api.any_mesh",
    "spectrum": "api.spectra",
    "train": "api.models",
    "view": "reports.notebook",
    "write": "api.any_mesh",
}

__all__ = [
    "CascadenormError",
    "ConfigError",
    "Controls",
    "DenoiseError",
    "Denoiser",
    "DenoisingSummary",
    "Inspection",
    "Measures",
    "Mesh",
    "MeshError",
    "MissingDependencyError",
    "OutputError",
    "ParameterError",
    "ReadError",
    "Spectrum",
    "TrainConfig",
    "Whole",
    "WorkerError",
    "compare",
    "denoise",
    "denoise_file",
    "denoise_files",
    "denoise_region_files",
    "denoise_regions",
    "evaluate",
    "farthest_points",
    "fast_harmonics",
    "fill_holes",
    "from_arrays",
    "geodesic_distances",
    "inspect",
    "manifold_harmonics",
    "methods",
    "progress_bar",
    "read",
    "read_config",
    "report",
    "shape_dna",
    "spectrum",
    "train",
    "view",
    "write",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'cascadenorm' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"cascadenorm.{_HOMES[name]}"), name)
    return value


def _described(mesh: object) -> str:
    """Describe a mesh in HTML by what draws meshes, which is loaded when a notebook first shows one."""
    return str(import_module("cascadenorm.reports.notebook").described(mesh))


display.described = _described


def __dir__() -> list[str]:
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])
