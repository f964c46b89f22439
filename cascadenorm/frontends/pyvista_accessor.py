"""The accessor `mesh.cascadenorm` on PyVista datasets; PyVista finds this module by its entry point."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pyvista

from cascadenorm.api.api import DEFAULT_METHOD, compare
from cascadenorm.api.inspection import Inspection, inspect
from cascadenorm.execution.progress import Listener
from cascadenorm.frontends.progress_bars import progress_bar
from cascadenorm.frontends.vtk_data import denoised
from cascadenorm.geometry.metrics import Measures
from cascadenorm.registry.controls import with_control_parameters

NAME = "cascadenorm"


@pyvista.register_dataset_accessor(NAME, pyvista.MultiBlock)
class BlocksAccessor:
    """Denoise the blocks of a `pyvista.MultiBlock`, such as the regions of a segmentation, together."""

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset

    @with_control_parameters
    def denoise(self, *, method: str = DEFAULT_METHOD, progress_bar: bool = False, **parameters: Any) -> Any:
        """Return a denoised copy of the dataset.

        Walls shared by blocks stay shared. Point, cell and field data are kept; normals are recomputed.

        Parameters
        ----------
        method
            One of `cascadenorm.methods()`.
        progress_bar
            Whether to show a tqdm progress bar, as PyVista filters do.
        parameters
            Parameters of the method, and controls. For a single PolyData, `mask` and `fixed` may be names of point
            arrays, and `only` that of a cell array or "array=value".

        Returns
        -------
        A dataset of the same type

        Raises
        ------
        MeshError, ParameterError
            As in `cascadenorm.denoise`.
        MissingDependencyError
            A progress bar is requested and tqdm is not installed.
        """
        with _bar(progress_bar, parameters.pop("progress", None)) as progress:
            settings = {**parameters, "method": method, "progress": progress}
            return pyvista.wrap(denoised(self._dataset, settings))


@pyvista.register_dataset_accessor(NAME, pyvista.PolyData)
class PolyDataAccessor(BlocksAccessor):
    """Denoise, inspect or measure a `pyvista.PolyData` of triangles."""

    def inspect(self, *, self_intersections: bool | None = None) -> Inspection:
        """Return the properties, defects and noise of the mesh, as `cascadenorm.inspect` does."""
        return inspect(self._dataset, self_intersections=self_intersections)

    def compare(self, truth: Any) -> Measures:
        """Measure the mesh against the ground truth, a mesh of any kind that `cascadenorm.compare` accepts."""
        return compare(self._dataset, truth)


@contextmanager
def _bar(shown: bool, listener: Listener | None) -> Iterator[Listener | None]:
    """Yield a progress listener that updates a bar, calls `listener`, or both; None if there is neither."""
    if not shown:
        yield listener
        return
    with progress_bar() as bar:

        def show(fraction: float) -> None:
            bar(fraction)
            if listener is not None:
                listener(fraction)

        yield show
