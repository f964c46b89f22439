"""Denoise and compare meshes given as files, arrays or library objects."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from hashlib import sha256
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar, overload

from numpy.typing import ArrayLike, NDArray

import cascadenorm.baselines  # noqa: F401 - registers its methods, as the learned ones do
from cascadenorm.api.apply import run_with_controls
from cascadenorm.api.halo import Whole as Whole  # public here, since this module registers all methods
from cascadenorm.api.opened_files import Denoised, DenoisingSummary, opened_file, written_file
from cascadenorm.api.patch_sizes import STEPWISE_METHODS, check_works_in_patches, patches_within, works_in_patches
from cascadenorm.api.seamless import SeamlessMesh
from cascadenorm.compute.compile_time import Stopwatch
from cascadenorm.errors import OutputError, ParameterError
from cascadenorm.execution.memory import (
    FACE_BYTES,
    OTHER_FACE_BYTES,
    USABLE_FRACTION,
    format_bytes,
    free_memory,
    parse_bytes,
)
from cascadenorm.geometry.metrics import Measures, measure
from cascadenorm.io.digests import file_digest
from cascadenorm.io.interop import as_mesh
from cascadenorm.learned.methods import SHIPPED, Learned, loaded, weights_file
from cascadenorm.mesh import limit_threads
from cascadenorm.registry import Method, find, registered
from cascadenorm.registry.controls import CONTROLS, Controls, checked_controls, with_control_parameters

if TYPE_CHECKING:
    from typing_extensions import Unpack

DEFAULT_METHOD = "auto"

AnyMesh = TypeVar("AnyMesh")


@overload
def denoise(
    mesh: tuple[ArrayLike, ArrayLike], faces: None = None, *, method: str = ..., **parameters: Any
) -> NDArray[Any]: ...
@overload  # controls only, for editors; the last two overloads also accept parameters of the method
def denoise(mesh: AnyMesh, faces: None = None, *, method: str = ..., **controls: Unpack[Controls]) -> AnyMesh: ...
@overload
def denoise(mesh: ArrayLike, faces: ArrayLike, *, method: str = ..., **controls: Unpack[Controls]) -> NDArray[Any]: ...
@overload
def denoise(mesh: AnyMesh, faces: None = None, *, method: str = ..., **parameters: Any) -> AnyMesh: ...
@overload
def denoise(mesh: ArrayLike, faces: ArrayLike, *, method: str = ..., **parameters: Any) -> NDArray[Any]: ...
@with_control_parameters
def denoise(mesh: Any, faces: ArrayLike | None = None, *, method: str = DEFAULT_METHOD, **parameters: Any) -> Any:
    """Denoise a mesh and return a result of the same type; the input is not changed.

    Parameters
    ----------
    mesh
        A pair of arrays, vertices (n, 3) and faces (m, 3); a `cascadenorm.Mesh`; a mesh of trimesh, pyvista, vtk,
        open3d or meshio, where copies of a vertex at seams stay together; a file that `read` returned; or the path of
        a file. If `faces` is given, the vertices (n, 3) alone.
    faces
        (m, 3) integers in 0 … n - 1, unless `mesh` holds them.
    method
        Name of a method listed by `methods()`.
    parameters
        Parameters of the method, as listed by `methods()`, such as `iterations=5` or, for learned methods,
        `model=path`.

    For a file, `mask`, `fixed`, `only` and `creases` also accept names from the file, as in `denoise_file`.

    Returns
    -------
    For arrays, the new vertices, (n, 3), float32 if the input is float32. For an object, a copy with its attributes.
    For a path, the path of a new file beside it, `<stem>_denoised<suffix>`, written as by `denoise_file`

    Raises
    ------
    MeshError
        The mesh is invalid. Its subclass ReadError is raised if a file cannot be read.
    ParameterError
        A method or parameter is unknown, a value is out of range, or a mask has the wrong shape.
    DenoiseError
        The method returned no usable vertices.
    OutputError
        The output file already exists or cannot be written.
    MissingDependencyError
        A package that the format needs is not installed.
    """
    controls = checked_controls({name: parameters.pop(name) for name in CONTROLS if name in parameters})
    chosen = find(method)
    chosen.checked(parameters, further=tuple(CONTROLS))
    if isinstance(faces, str | PathLike):
        raise ParameterError(
            f"is {fspath(faces)!r}, a path; it must be an array",
            parameter="faces",
            hint="to name the file that is written call denoise_file(source, output)",
        )
    if faces is None and isinstance(mesh, str | PathLike):
        try:
            done = denoise_file_with_meshes(fspath(mesh), method=method, parameters=parameters, **controls)
        except OutputError as error:
            if error.remedy is not None:  # force, which is an argument of `denoise_file` only
                error.hint, error.remedy = "call denoise_file(source, output), with force=True to overwrite", None
            raise
        return Path(done.summary.output)
    with limit_threads(controls["threads"]):
        given = SeamlessMesh.of(mesh if faces is None else (mesh, faces), isolate=controls["on_bad"] == "isolate")
        over = given.controls(controls)
        applied = run_with_controls(chosen, given.mesh, parameters, over, dtype=given.dtype)
        return given.moved(applied.vertices, controls)


@with_control_parameters
def denoise_file(
    source: str | PathLike[str] | BinaryIO,
    output: str | PathLike[str] | BinaryIO | None = None,
    *,
    method: str = DEFAULT_METHOD,
    format: str | None = None,
    force: bool = False,
    weld: float | str | None = None,
    drop_components: str | int | None = None,
    parameters: dict[str, Any] | None = None,
    memory: str | int | None = None,
    scheduler: str | None = None,
    **controls: Unpack[Controls],
) -> DenoisingSummary:
    """Denoise a mesh file and keep everything in it except positions and normals.

    Parameters
    ----------
    source
        Path or binary stream.
    output
        Path, whose extension selects the format, or binary stream. None writes `<stem>_denoised<suffix>` beside the
        source.
    method
        Name of a method listed by `methods()`.
    format
        Format of an output stream, such as "stl". None uses the format of the source. For a path, the extension
        decides.
    force
        Replace an existing file.
    weld
        Largest distance at which boundary vertices are joined, for files that round the copies of a vertex to different
        positions; in mesh units or as text like "0.001 edges". Must be below half the mean edge length.
    drop_components
        Leave out connected components with fewer faces than this number, such as 50, or than this share of the largest
        component, such as "1%". None keeps all components. `left_out` of the result lists any other losses.
    parameters
        Parameters of the method.
    memory
        Memory limit for the process, as bytes or as text like "4GB". If the whole mesh needs more, the method works in
        patches; `auto` and `cascade` then agree to 1e-5 of an edge at nearly all vertices, and other methods write the
        same bytes (docs/patches.md). None sets no limit.
    scheduler
        Address of a Dask scheduler whose workers process the patches, or "local" for a cluster on this machine.
        `memory` then applies to each worker process.

    Arrays in controls refer to the vertices and triangles of `read(source).mesh`. Names and indices in
    text refer to the vertices of the file, from 0. If the file splits a vertex at a seam, the smallest weight of its
    copies applies.

    Returns
    -------
    Summary of the run. With `on_bad="isolate"`, bad faces keep their places in the file

    Raises
    ------
    ReadError, MeshError, ParameterError, OutputError, MissingDependencyError
        As in `denoise`. In these cases, nothing is written.
    """
    return denoise_file_with_meshes(
        source,
        output,
        method=method,
        format=format,
        force=force,
        weld=weld,
        drop_components=drop_components,
        parameters=parameters,
        memory=memory,
        scheduler=scheduler,
        **controls,
    ).summary


def denoise_file_with_meshes(
    source: str | PathLike[str] | BinaryIO,
    output: str | PathLike[str] | BinaryIO | None = None,
    *,
    method: str = DEFAULT_METHOD,
    format: str | None = None,
    force: bool = False,
    weld: float | str | None = None,
    drop_components: str | int | None = None,
    parameters: dict[str, Any] | None = None,
    memory: str | int | None = None,
    scheduler: str | None = None,
    on_short: Callable[[str], object] | None = None,
    **controls: Unpack[Controls],
) -> Denoised:
    """Denoise a mesh file as `denoise_file` does, and return the meshes as well.

    Without `memory`, the method switches to patches if the whole mesh needs more memory than is free, after `on_short`
    was called with the reason. Without `on_short`, free memory is not checked.
    """
    every, chosen, given = checked_controls(controls), find(method), parameters or {}
    chosen.checked(given)
    if scheduler is not None and memory is None:
        problem = "works on patches, which fit into the memory of a worker"
        raise ParameterError(problem, parameter="scheduler", remedy=("memory", "4GB"))
    limit = None if memory is None else parse_bytes(memory)
    if limit is not None:
        check_works_in_patches(chosen, given)
    with limit_threads(every["threads"]):
        opened = opened_file(
            source, output, every, format=format, drop_components=drop_components, force=force, weld=weld
        )
        mesh, dtype = opened.mesh, opened.file.positions.dtype
        watch = Stopwatch()
        if limit is None and on_short is not None:
            limit = _memory_for_patches(chosen, given, len(mesh.faces), on_short)
        with nullcontext() if limit is None else patches_within(limit, len(mesh.faces), scheduler):
            applied = run_with_controls(chosen, mesh, given, opened.controls, dtype=dtype)
        seconds = watch.seconds()
        return written_file(opened, applied, chosen, given, every, seconds=seconds, force=force)


def _memory_for_patches(
    method: Method, parameters: dict[str, Any], faces: int, on_short: Callable[[str], object]
) -> int | None:
    """Return the memory for patches and report the reason if the whole mesh needs more than is free; else None."""
    need, free = faces * (FACE_BYTES if method.name in STEPWISE_METHODS else OTHER_FACE_BYTES), free_memory()
    if free is None or need <= free or not works_in_patches(method, parameters):
        return None
    on_short(f"{method.name} needs about {format_bytes(need)} for {faces:,} faces, and {format_bytes(free)} are free")
    return int(USABLE_FRACTION * free)


def methods() -> dict[str, Method]:
    """Return all methods.

    Returns
    -------
    Methods by name, including your own, each with its source, parameters, units, ranges and defaults.
    """
    return registered()


def check_weights(method: str, parameters: Mapping[str, Any]) -> None:
    """Raise ParameterError if the given weights of a method are invalid."""
    if method in SHIPPED and parameters.get("model") is not None:
        loaded(parameters["model"], method)


def weights_digest(method: str, parameters: Mapping[str, Any]) -> str | None:
    """Return the SHA-256 of the weights that a method uses with some parameters; None for a method without weights."""
    if method not in SHIPPED:
        return None
    model = parameters.get("model")
    if isinstance(model, Learned):
        return sha256(model.to_bytes()).hexdigest()
    return file_digest(weights_file(method, model))


def compare(mesh: Any, reference: Any) -> Measures:
    """Measure a mesh against its ground truth.

    Parameters
    ----------
    mesh, reference
        Meshes of any kind that `denoise` accepts.

    Returns
    -------
    Angles in degrees, and distances in mean edge lengths or diagonals of the reference mesh.

    Raises
    ------
    MeshError
        A mesh is invalid. Its subclass ReadError is raised if a file cannot be read.
    """
    return measure(as_mesh(mesh), as_mesh(reference))
