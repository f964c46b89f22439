"""Versions of internal functions that accept any kind of mesh."""

import inspect
from collections.abc import Callable
from functools import wraps
from os import PathLike
from typing import Any, BinaryIO, Concatenate, ParamSpec, TypeVar, cast

from cascadenorm import io
from cascadenorm.geometry import geodesics
from cascadenorm.geometry.holes import filling
from cascadenorm.geometry.spectra import farthest_points as sampling
from cascadenorm.geometry.spectra import fast_harmonics as approximate
from cascadenorm.geometry.spectra import harmonics
from cascadenorm.io.interop import as_file, as_mesh
from cascadenorm.mesh import Mesh

Settings = ParamSpec("Settings")
Result = TypeVar("Result")


def on_any_mesh(
    function: Callable[Concatenate[Mesh, Settings], Result],
) -> Callable[Concatenate[Any, Settings], Result]:
    """Let a function of a `Mesh` accept any mesh that `as_mesh` converts."""

    # Leave __module__ unset, because pickle looks the result up in this module
    @wraps(function, assigned=("__name__", "__qualname__", "__doc__", "__annotations__"))
    def converting(mesh: Any, *arguments: Settings.args, **settings: Settings.kwargs) -> Result:
        return function(as_mesh(mesh), *arguments, **settings)

    signature = inspect.signature(function)
    first, *others = signature.parameters.values()
    shown = signature.replace(parameters=[first.replace(annotation=Any), *others])
    converting.__signature__ = shown  # type: ignore[attr-defined]
    return cast(Callable[Concatenate[Any, Settings], Result], converting)


farthest_points = on_any_mesh(sampling.farthest_points)
fast_harmonics = on_any_mesh(approximate.fast_harmonics)
fill_holes = on_any_mesh(filling.fill_holes)
geodesic_distances = on_any_mesh(geodesics.geodesic_distances)
manifold_harmonics = on_any_mesh(harmonics.manifold_harmonics)
shape_dna = on_any_mesh(harmonics.shape_dna)


def write(
    mesh: Any, target: str | PathLike[str] | BinaryIO, *, format: str | None = None, force: bool = False
) -> list[str]:
    """Write a mesh to a file, converting it if the extension names another format.

    Parameters
    ----------
    mesh
        A file that `read` returned, which keeps its other content, or any mesh that `denoise` accepts.
    target
        Path or binary stream.
    format
        Defaults to the format of the extension. For a stream, defaults to the format of the file, or to "ply".
    force
        Replace an existing file.

    Returns
    -------
    Content that the target format cannot hold and that was left out, in words; empty if nothing was lost

    Raises
    ------
    MeshError
        The mesh is invalid.
    OutputError
        The target exists and `force` is False, or it cannot be written. No partial file is left behind.
    """
    return io.write(as_file(mesh), target, format=format, force=force)
