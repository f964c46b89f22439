"""Denoising and comparing meshes of any kind: files, arrays, and the meshes of other libraries."""

from __future__ import annotations

import time
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

import cascadenorm.baselines
import cascadenorm.learned.cascade  # noqa: F401 - both register their methods
from cascadenorm import io
from cascadenorm.controls.controls import controlled, in_words
from cascadenorm.controls.limits import framed_length
from cascadenorm.controls.selection import selected, welded
from cascadenorm.controls.settings import CONTROLS, Controls, checked, takes_controls
from cascadenorm.controls.weights import selected_faces
from cascadenorm.errors import ReadError
from cascadenorm.evaluation.metrics import Measures, measure
from cascadenorm.geometry.error_kind import ErrorKind, error_kind
from cascadenorm.geometry.holes import fill_holes
from cascadenorm.geometry.laplacians import Order
from cascadenorm.interop import adapter, as_mesh, mesh_of_file, source_name
from cascadenorm.io.atomic import check_output, is_special
from cascadenorm.io.files import check_target, extensible
from cascadenorm.io.patches import Patches
from cascadenorm.io.welding import weld
from cascadenorm.mesh import (
    Mesh,
    bad_faces,
    bad_vertices,
    in_frame,
    in_good_order,
    isolated,
    limit_threads,
    without_lines,
)
from cascadenorm.registry import Method, find, registered

if TYPE_CHECKING:
    from typing_extensions import Unpack

DEFAULT_METHOD = "auto"

AnyMesh = TypeVar("AnyMesh")


@dataclass(frozen=True, kw_only=True)
class Report:
    """What was done to a file.

    Parameters
    ----------
    source, output : names of the files, or of the streams
    method, parameters : what was applied, and the parameters that were given
    strength : as given
    controls : the other controls that decide on the result, as given; arrays by their shape alone
    vertices, faces : counts; vertices that the file splits at seams count once
    isolated_vertices, isolated_faces : vertices that are not finite, and further faces, that were left as they are
    moved : vertices with another position
    mean_displacement, largest_displacement : over all vertices, in mean edge lengths
    seconds : of the method, without reading and writing
    error : the kind of error that was found; None where the method is not `auto`, or nothing was to be taken away
    left_out : what the source holds and the format of the output cannot, in words
    """

    source: str
    output: str
    method: str
    parameters: dict[str, Any]
    strength: float
    controls: dict[str, Any]
    vertices: int
    faces: int
    isolated_vertices: int
    isolated_faces: int
    moved: int
    mean_displacement: float
    largest_displacement: float
    seconds: float
    error: ErrorKind | None
    left_out: tuple[str, ...]


class Denoised(NamedTuple):
    """What was done to a file, with the file as it was read and as it was written."""

    report: Report
    before: io.MeshFile
    after: io.MeshFile


@overload  # with the controls alone, for editors; parameters of the method are those of the last two
def denoise(mesh: AnyMesh, faces: None = None, *, method: str = ..., **controls: Unpack[Controls]) -> AnyMesh: ...
@overload
def denoise(mesh: ArrayLike, faces: ArrayLike, *, method: str = ..., **controls: Unpack[Controls]) -> NDArray[Any]: ...
@overload
def denoise(mesh: AnyMesh, faces: None = None, *, method: str = ..., **parameters: Any) -> AnyMesh: ...
@overload
def denoise(mesh: ArrayLike, faces: ArrayLike, *, method: str = ..., **parameters: Any) -> NDArray[Any]: ...
@takes_controls
def denoise(mesh: Any, faces: ArrayLike | None = None, *, method: str = DEFAULT_METHOD, **parameters: Any) -> Any:
    """Denoise a mesh; the input is never changed, and the result is of the same type.

    Parameters
    ----------
    mesh : vertices as an (n, 3) array, with `faces`; or alone a `cascadenorm.Mesh`, a mesh of trimesh, pyvista, vtk,
        open3d or meshio, of which copies of a vertex at seams stay together; or the path of a file
    faces : (m, 3) integers in 0 … n - 1
    method : one of `methods()`
    parameters : of the method, as `methods()` lists them, such as `iterations=5` or, for the learned methods,
        `model=path`

    For the path of a file, mask, fixed, only and creases may be given by names in the file, as in `denoise_file`.

    Returns
    -------
    For arrays the new vertices, (n, 3), float32 if they are given so; for an object a copy with its attributes; for a
    path the path of a new file beside it, `<stem>_denoised<suffix>`, as `denoise_file` writes it

    Raises
    ------
    MeshError : no valid mesh; its subclass ReadError where a file cannot be read
    ParameterError : an unknown method or parameter, a value out of range, a mask of the wrong shape
    OutputError : the file to be written exists already, or cannot be written
    MissingDependencyError : a package for the format or the device is not installed
    """
    controls = checked({name: parameters.pop(name) for name in CONTROLS if name in parameters})
    chosen = find(method)
    with limit_threads(controls["threads"]):
        if faces is not None:
            return _denoised(chosen, mesh, faces, parameters, controls)
        if isinstance(mesh, str | PathLike):
            return Path(_denoised_file(chosen, fspath(mesh), None, parameters, controls, force=False).report.output)
        if isinstance(mesh, Mesh):
            return mesh.moved(_denoised(chosen, mesh.vertices, mesh.faces, parameters, controls))
        return _denoised_object(chosen, mesh, parameters, controls)


@takes_controls
def denoise_file(
    source: str | PathLike[str] | BinaryIO,
    output: str | PathLike[str] | BinaryIO | None = None,
    *,
    method: str = DEFAULT_METHOD,
    format: str | None = None,
    force: bool = False,
    parameters: dict[str, Any] | None = None,
    **controls: Unpack[Controls],
) -> Report:
    """Denoise a mesh file; everything in it but positions and normals is kept.

    Parameters
    ----------
    source : path, or a binary stream
    output : path, whose extension selects the format, or a binary stream; None is `<stem>_denoised<suffix>` beside the
        source
    method : one of `methods()`
    format : that of a stream, such as "stl"; None is that of the source. The extension of a path decides for it
    force : replace an existing file
    parameters : of the method

    Controls count the vertices and triangles of `read(source).mesh`. Given by names, they count the vertices of the
    file, from 0; where it splits a vertex at a seam, the smallest weight of the copies counts.

    Returns
    -------
    What was done; faces that were isolated keep their places in the file

    Raises
    ------
    ReadError, MeshError, ParameterError, OutputError, MissingDependencyError : as in `denoise`; nothing is written then
    """
    return denoised_file(
        source, output, method=method, format=format, force=force, parameters=parameters, **controls
    ).report


def denoised_file(
    source: str | PathLike[str] | BinaryIO,
    output: str | PathLike[str] | BinaryIO | None = None,
    *,
    method: str = DEFAULT_METHOD,
    format: str | None = None,
    force: bool = False,
    parameters: dict[str, Any] | None = None,
    **controls: Unpack[Controls],
) -> Denoised:
    """Denoise a mesh file as `denoise_file` does; the meshes are returned as well."""
    every = checked(controls)
    with limit_threads(every["threads"]):
        return _denoised_file(find(method), source, output, parameters or {}, every, format=format, force=force)


def methods() -> dict[str, Method]:
    """Return every method by name, with its source and its parameters, their units, ranges and defaults."""
    return registered()


def compare(mesh: Any, *others: Any) -> Measures:
    """Measure a mesh against the true one.

    Call it with two meshes of any kind that `denoise` takes, `compare(mesh, reference)`, or with arrays,
    `compare(vertices, faces, true_vertices)`, and `true_faces` last where they differ.
    """
    if len(others) == 1:
        return measure(as_mesh(mesh), as_mesh(others[0]))
    if len(others) not in (2, 3):
        raise TypeError("compare takes (mesh, reference) or (vertices, faces, true_vertices[, true_faces])")
    return measure(Mesh(mesh, others[0]), Mesh(others[1], others[-1] if len(others) == 3 else others[0]))


@dataclass(frozen=True, kw_only=True)
class Filling:
    """What was added to a file.

    Parameters
    ----------
    faces, added : triangles that were there, and further ones
    left_out : what the source holds and the output does not, in words
    """

    faces: int
    added: int
    left_out: tuple[str, ...]


def fill_holes_file(
    source: Path, output: Path, *, order: Order = 2, max_edges: int | None = None, force: bool = False
) -> Filling:
    """Fill the holes of a mesh file, as `fill_holes` does; what is there stays, and the patches get values like it.

    PLY and OBJ keep all that they hold, in other formats what is kept is what another format could take over.

    Raises
    ------
    ReadError, MeshError, ParameterError, OutputError : nothing is written then
    """
    check_output(output, force=force)
    io.output_format(output)
    read = io.read(source)
    mesh_of_file(read, source_name(source))
    file, lost = extensible(read)
    filled = fill_holes(file.mesh, order=order, max_edges=max_edges)
    added = len(filled.faces) - len(file.mesh.faces)
    if added:
        left_out = lost + io.write(file.with_patches(Patches(file, filled)), output, force=force)
    else:
        left_out = io.write(read, output, force=force)
    return Filling(faces=len(file.mesh.faces), added=added, left_out=tuple(dict.fromkeys(left_out)))


def beside(source: Path, what: str) -> Path:
    """Return `<stem>_<what><suffix>` in the folder of a mesh file; raises ReadError for a folder."""
    if source.is_dir():
        raise ReadError(f"{source} is a folder", hint="give the name of a mesh file in it")
    return source.with_name(f"{source.stem}_{what}{source.suffix}")


def _denoised(
    method: Method, vertices: ArrayLike, faces: ArrayLike, parameters: dict[str, Any], controls: Controls
) -> NDArray[Any]:
    given = np.asarray(vertices)
    dtype = given.dtype if given.dtype.kind == "f" else np.dtype(np.float64)
    if controls["on_bad"] == "error":
        return controlled(method, Mesh(vertices, faces), parameters, controls, dtype=dtype)
    mesh = isolated(vertices, faces)
    if controls["only"] is not None:  # counts the bad faces as well
        good = ~bad_faces(vertices, faces)
        controls = {**controls, "only": selected_faces(controls["only"], len(good))[good]}
    denoised = controlled(method, mesh, parameters, controls, dtype=dtype)
    return np.where(bad_vertices(given)[:, None], given, denoised)


def _denoised_object(method: Method, mesh: Any, parameters: dict[str, Any], controls: Controls) -> Any:
    """Denoise a mesh of another library, of which copies of vertices at seams stay together."""
    kind = adapter(mesh)
    vertices, faces = kind.arrays(mesh)
    within = ((faces >= 0) & (faces < len(vertices))).all(axis=1)
    joined = faces.astype(np.int64)
    welds, first = weld(vertices, joined[within])
    joined[within] = welds[joined[within]]
    denoised = _denoised(method, vertices[first], joined, parameters, welded(controls, welds))[welds]
    return kind.with_vertices(mesh, np.where(denoised == vertices, vertices, denoised))  # -0 stays -0


def _denoised_file(
    method: Method,
    source: str | PathLike[str] | BinaryIO,
    output: str | PathLike[str] | BinaryIO | None,
    parameters: dict[str, Any],
    controls: Controls,
    *,
    format: str | None = None,
    force: bool,
) -> Denoised:
    method.checked(parameters)
    opened = opened_file(source, output, controls, format=format, force=force)
    start = time.perf_counter()
    vertices = controlled(method, opened.mesh, parameters, opened.controls, dtype=opened.file.positions.dtype)
    seconds = time.perf_counter() - start
    return written_file(opened, vertices, method, parameters, controls, seconds=seconds, force=force)


class Opened(NamedTuple):
    """A file that was read, and where it will be written.

    Parameters
    ----------
    format : of the output
    mesh : n vertices
    controls : over the mesh, where they were given by names in the file
    """

    source: str | PathLike[str] | BinaryIO
    output: str | PathLike[str] | BinaryIO
    format: str
    file: io.MeshFile
    mesh: Mesh
    controls: Controls


def opened_file(
    source: str | PathLike[str] | BinaryIO,
    output: str | PathLike[str] | BinaryIO | None,
    controls: Controls,
    *,
    format: str | None = None,
    force: bool,
) -> Opened:
    """Read a file to be denoised; everything that can be refused before reading is refused before."""
    output = _checked_output(source, output, format, force=force)
    file = io.read(source)
    if controls["on_bad"] == "isolate":
        file = file.isolating()
    chosen = io.output_format(output, format or file.format)
    check_target(file, output, format=chosen, force=force)
    mesh = mesh_of_file(file, source_name(source))
    return Opened(source, output, chosen, file, mesh, selected(controls, file))


def written_file(
    opened: Opened,
    vertices: NDArray[np.float64],
    method: Method,
    parameters: dict[str, Any],
    controls: Controls,
    *,
    seconds: float,
    force: bool,
) -> Denoised:
    """Write a file with other vertices of its mesh, (n, 3), and report what was done; controls as they were given."""
    source, output, file, mesh = opened.source, opened.output, opened.file, opened.mesh

    # Formats with whole numbers need the limit to round within it
    small, exponent = in_frame(without_lines(mesh))  # squares of lengths overflow where coordinates are huge
    with np.errstate(over="ignore"):
        framed = framed_length("max_displacement", controls["max_displacement"], small, exponent)
        limit = float(np.ldexp(framed, exponent))
    try:
        moved = file.with_vertices(vertices, limit=limit)
        left_out = io.write(moved, output, format=opened.format, force=force)
    except ReadError as error:  # a fault of the source that only other formats need to know
        raise error.within(source_name(source)) from error.__cause__

    moves = np.linalg.norm(np.ldexp(vertices - mesh.vertices, -exponent), axis=1)
    in_edges = moves / small.mean_edge_length if small.mean_edge_length > 0 else moves
    report = Report(
        source=source_name(source),
        output=source_name(output),
        method=method.name,
        parameters=parameters,
        strength=controls["strength"],
        controls=in_words(controls),
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        isolated_vertices=int(file.bad_vertices.sum()),
        isolated_faces=int(file.left_out.sum()),
        moved=int((moves > 0).sum()),
        mean_displacement=float(in_edges.mean()),
        largest_displacement=float(in_edges.max()),
        seconds=seconds,
        error=_error_found(method, mesh, vertices, controls["strength"]),
        left_out=tuple(left_out),
    )
    return Denoised(report, file, moved)


def _error_found(method: Method, mesh: Mesh, vertices: NDArray[np.float64], strength: float) -> ErrorKind | None:
    """Tell the kind of error from what `auto` took away, of which a strength below 1 takes only a share."""
    if method.name != DEFAULT_METHOD or not strength:
        return None
    small, exponent = in_frame(without_lines(mesh))
    order = in_good_order(small)
    moves = np.ldexp(vertices - mesh.vertices, -exponent)[order.numbers] / min(strength, 1.0)
    return error_kind(order.mesh, order.mesh.vertices + moves, exponent=exponent)


def _checked_output(
    source: str | PathLike[str] | BinaryIO,
    output: str | PathLike[str] | BinaryIO | None,
    format: str | None,
    *,
    force: bool,
) -> str | PathLike[str] | BinaryIO:
    """Return where to write; raises OutputError where that is impossible or not allowed."""
    if output is None:
        if not isinstance(source, str | PathLike):
            raise TypeError("a stream has no place for its output: give one")
        output = beside(Path(source), "denoised")
        check_output(output, force=force)
    elif isinstance(output, str | PathLike):
        check_output(Path(output), force=force)
        if not is_special(output):
            io.output_format(output)
    elif format is not None:
        io.output_format(output, format)
    return output
