"""Functions of other rooms for meshes of any kind."""

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
    """Let a function of a `Mesh` take a mesh of any kind, as `as_mesh` does."""

    # without __module__, since pickle finds the result in this module
    @wraps(function, assigned=("__name__", "__qualname__", "__doc__", "__annotations__"))
    def converting(mesh: Any, *arguments: Settings.args, **settings: Settings.kwargs) -> Result:
        return function(as_mesh(mesh), *arguments, **settings)

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
    """Write a mesh, whole or not at all; in another format if the extension says so.

    Parameters
    ----------
    mesh
        A file that `read` returned, which keeps its other content; or a mesh of any kind that `denoise` takes.
    target
        Path, or a stream of bytes.
    format
        By default that of the extension, and for a stream that of the file, or "ply" where there is none.
    force
        Replace an existing file.

    Returns
    -------
    What the target cannot hold and was left out, in words; empty if nothing was

    Raises
    ------
    MeshError
        No valid mesh.
    OutputError
        The target exists and force is not given, or it cannot be written.
    """
    return io.write(as_file(mesh), target, format=format, force=force)
