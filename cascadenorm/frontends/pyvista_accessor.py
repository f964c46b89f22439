"""`mesh.cascadenorm` on the datasets of PyVista, which finds this module by its entry point when it is first used."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pyvista

from cascadenorm.api.api import DEFAULT_METHOD, compare
from cascadenorm.controls.settings import takes_controls
from cascadenorm.execution.progress import Listener
from cascadenorm.frontends.progress_bars import progress_bar
from cascadenorm.frontends.vtk_data import denoised
from cascadenorm.geometry.metrics import Measures
from cascadenorm.inspection import Inspection, inspect

NAME = "cascadenorm"


@pyvista.register_dataset_accessor(NAME, pyvista.MultiBlock)
class BlocksAccessor:
    """Denoise the blocks of a `pyvista.MultiBlock`, such as the regions of a segmentation, together."""

    def __init__(self, dataset: Any) -> None:
        self._dataset = dataset

    @takes_controls
    def denoise(self, *, method: str = DEFAULT_METHOD, progress_bar: bool = False, **parameters: Any) -> Any:
        """Return a denoised copy; the dataset is not changed.

        Walls that blocks share stay shared. Point, cell and field data are kept, and normals are computed anew.

        Parameters
        ----------
        method
            One of `cascadenorm.methods()`.
        progress_bar
            Show the fraction done by tqdm, as filters of PyVista do.
        parameters
            Of the method.

        Of one PolyData mask and fixed may be names of point arrays, only that of a cell array, or "array=value".

        Returns
        -------
        A dataset of the same type

        Raises
        ------
        MeshError, ParameterError
            As in `cascadenorm.denoise`.
        MissingDependencyError
            Tqdm is not installed, and a progress bar is asked for.
        """
        with _bar(progress_bar, parameters.pop("progress", None)) as progress:
            settings = {**parameters, "method": method, "progress": progress}
            return pyvista.wrap(denoised(self._dataset, settings))


@pyvista.register_dataset_accessor(NAME, pyvista.PolyData)
class PolyDataAccessor(BlocksAccessor):
    """Denoise, inspect or measure a `pyvista.PolyData` of triangles."""

    def inspect(self, *, self_intersections: bool | None = None) -> Inspection:
        """Return what the mesh is, its defects and where they are, and how noisy it is; see `cascadenorm.inspect`."""
        return inspect(self._dataset, self_intersections=self_intersections)

    def compare(self, truth: Any) -> Measures:
        """Measure the mesh against the true one, of any kind that `cascadenorm.compare` takes."""
        return compare(self._dataset, truth)


@contextmanager
def _bar(shown: bool, listener: Listener | None) -> Iterator[Listener | None]:
    """Give what is to be called with the fraction done: a bar, a listener, both or neither."""
    if not shown:
        yield listener
        return
    with progress_bar() as bar:

        def show(fraction: float) -> None:
            bar(fraction)
            if listener is not None:
                listener(fraction)

        yield show
