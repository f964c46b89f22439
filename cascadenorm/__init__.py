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
    from cascadenorm.api.any_mesh import farthest_points as farthest_points
    from cascadenorm.api.any_mesh import fast_harmonics as fast_harmonics
    from cascadenorm.api.any_mesh import fill_holes as fill_holes
    from cascadenorm.api.any_mesh import geodesic_distances as geodesic_distances
    from cascadenorm.api.any_mesh import manifold_harmonics as manifold_harmonics
    from cascadenorm.api.any_mesh import shape_dna as shape_dna
    from cascadenorm.api.any_mesh import write as write
    from cascadenorm.api.api import Whole as Whole
    from cascadenorm.api.api import compare as compare
    from cascadenorm.api.api import denoise as denoise
    from cascadenorm.api.api import denoise_file as denoise_file
    from cascadenorm.api.api import methods as methods
    from cascadenorm.api.inspection import Inspection as Inspection
    from cascadenorm.api.inspection import inspect as inspect
    from cascadenorm.api.models import Denoiser as Denoiser
    from cascadenorm.api.models import train as train
    from cascadenorm.api.opened_files import DenoisingSummary as DenoisingSummary
    from cascadenorm.api.regions.regions import denoise_region_files as denoise_region_files
    from cascadenorm.api.regions.regions import denoise_regions as denoise_regions
    from cascadenorm.api.spectra import Spectrum as Spectrum
    from cascadenorm.api.spectra import spectrum as spectrum
    from cascadenorm.batch.batch import denoise_files as denoise_files
    from cascadenorm.errors import CascadenormError as CascadenormError
    from cascadenorm.errors import ConfigError as ConfigError
    from cascadenorm.errors import DenoiseError as DenoiseError
    from cascadenorm.errors import MeshError as MeshError
    from cascadenorm.errors import MissingDependencyError as MissingDependencyError
    from cascadenorm.errors import OutputError as OutputError
    from cascadenorm.errors import ParameterError as ParameterError
    from cascadenorm.errors import ReadError as ReadError
    from cascadenorm.errors import WorkerError as WorkerError
    from cascadenorm.evaluation.harness import evaluate as evaluate
    from cascadenorm.frontends.progress_bars import progress_bar as progress_bar
    from cascadenorm.geometry.metrics import Measures as Measures
    from cascadenorm.io import from_arrays as from_arrays
    from cascadenorm.io import read as read
    from cascadenorm.learned.config import TrainConfig as TrainConfig
    from cascadenorm.learned.config import read_config as read_config
    from cascadenorm.mesh import Mesh as Mesh
    from cascadenorm.registry.controls import Controls as Controls
    from cascadenorm.reports import report as report
    from cascadenorm.reports.notebook import view as view

if (_checkout := Path(__file__).parents[1]).joinpath("baselines", "__init__.py").exists():
    # In a checkout `baselines/` and `data_gen/` lie beside the package instead of in it.
    __path__.append(str(_checkout))

_NAMES = {  # loaded when first used: the command line starts without numpy and numba
    "api.any_mesh": "farthest_points fast_harmonics fill_holes geodesic_distances manifold_harmonics shape_dna write",
    "api.api": "Whole compare denoise denoise_file methods",
    "api.inspection": "Inspection inspect",
    "api.models": "Denoiser train",
    "api.opened_files": "DenoisingSummary",
    "api.regions.regions": "denoise_region_files denoise_regions",
    "api.spectra": "Spectrum spectrum",
    "batch.batch": "denoise_files",
    "errors": "CascadenormError ConfigError DenoiseError MeshError MissingDependencyError OutputError "
    "ParameterError ReadError WorkerError",
    "evaluation.harness": "evaluate",
    "frontends.progress_bars": "progress_bar",
    "geometry.metrics": "Measures",
    "io": "from_arrays read",
    "learned.config": "TrainConfig read_config",
    "mesh": "Mesh",
    "registry.controls": "Controls",
    "reports": "report",
    "reports.notebook": "view",
}
"""Public names by the module that defines them."""
_HOMES = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = sorted(_HOMES)


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
