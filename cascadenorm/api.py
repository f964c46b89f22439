"""Denoising and comparing meshes of any kind: files, arrays, and the meshes of other libraries."""

import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any, BinaryIO, Literal, TypeVar, get_args, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

import cascadenorm.baselines
import cascadenorm.learned.cascade  # noqa: F401 - both register their methods
from cascadenorm import io
from cascadenorm.controls import Boundary, Controls, controlled, faces_within, framed_length
from cascadenorm.controls.selection import selected, welded
from cascadenorm.evaluation.metrics import Measures, measure
from cascadenorm.geometry.holes import fill_holes
from cascadenorm.geometry.laplacians import Order
from cascadenorm.interop import adapter, as_mesh, mesh_of_file, source_name
from cascadenorm.io.atomic import check_output, is_special
from cascadenorm.io.files import check_target, extensible
from cascadenorm.io.patches import Patches
from cascadenorm.io.welding import weld
from cascadenorm.mesh import Mesh, bad_faces, bad_vertices, in_frame, isolated, limit_threads, without_lines
from cascadenorm.registry import Method, ParameterError, find, registered

DEFAULT_METHOD = "auto"

AnyMesh = TypeVar("AnyMesh")

OnBad = Literal["error", "isolate"]
"""What becomes of vertices and faces that cannot be worked on."""


@dataclass(frozen=True, kw_only=True)
class Report:
    """What was done to a file.

    Parameters
    ----------
    source, output : names of the files, or of the streams
    method, parameters : what was applied, and what was set other than by default
    controls : mask, fixed, only, boundary, creases, keep_detail, max_displacement, volume and on_bad, as they were
        given; of arrays only their shapes, in words
    vertices, faces : their numbers; vertices that the file splits at seams count once
    isolated_vertices, isolated_faces : how many of the vertices, and how many faces besides, were left alone as bad
    moved : vertices that are elsewhere now
    mean_displacement, largest_displacement : of all vertices, in mean edge lengths
    seconds : for the method, without reading and writing
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
    left_out: tuple[str, ...]


@overload
def denoise(mesh: AnyMesh, faces: None = None, **settings: Any) -> AnyMesh: ...
@overload
def denoise(mesh: ArrayLike, faces: ArrayLike, **settings: Any) -> NDArray[Any]: ...
def denoise(
    mesh: Any,
    faces: ArrayLike | None = None,
    *,
    method: str = DEFAULT_METHOD,
    strength: float = 1.0,
    mask: ArrayLike | None = None,
    fixed: ArrayLike | None = None,
    only: ArrayLike | None = None,
    boundary: Boundary = "free",
    creases: float | ArrayLike | None = None,
    keep_detail: float | str | None = None,
    max_displacement: float | str | None = None,
    volume: Literal["keep"] | None = None,
    threads: int | None = None,
    progress: Callable[[float], object] | None = None,
    on_bad: OnBad = "error",
    **parameters: Any,
) -> Any:
    """Denoise a mesh; what is given is never changed, and the same kind comes back.

    Parameters
    ----------
    mesh : vertices as an (n, 3) array, with `faces`; or alone a `cascadenorm.Mesh`, a mesh of trimesh, pyvista, open3d
        or meshio, of which copies of a vertex at seams stay together; or the path of a file
    faces : (m, 3) integers in 0 … n - 1
    method : one of `methods()`
    strength : 0 nothing, 1 the method; between them a blend; above 1 the method is applied again to what came out
    mask : (n,) bool, or numbers from 0 to 1 that multiply the strength at each vertex; those with 0 keep their bits
    fixed : (n,) bool, or numbers of vertices, that keep their bits
    only : (m,) bool, or numbers of faces: vertices all of whose faces are among them move, the others keep their bits
    boundary : "free" moves rims by the method; "smooth" only off the surface, while along it the rim is smoothed as a
        curve with its corners kept; "fixed" keeps their bits
    creases : edges across which nothing is mixed: (k, 2) pairs of vertices; or an angle in degrees, and edges sharper
        than that are creases, of which noise makes some
    keep_detail : the smallest feature to keep, a length in the mesh's own unit, or as text in mean edge lengths:
        "4 edges"; what is wider stays, what is finer goes as the method says
    max_displacement : no vertex moves farther; in the mesh's own unit, or as text in mean edge lengths: "0.5 edges"
    volume : "keep" scales every closed part about its centroid to the volume that it had
    threads : at most this many; None: as many as there are. The result has the same bytes
    progress : called with the share that is done, from 0 to 1; what it raises ends the work
    on_bad : "error" refuses vertices that are not finite and faces that name vertices that do not exist; "isolate"
        takes them, faces that touch them, and faces that name a vertex twice out of what the method sees, and denoises
        the rest; a bad vertex keeps its bits, and `only` counts all faces that are given
    parameters : of the method, as `methods()` lists them, such as `iterations=5` or, for the cascade, `model=path`

    For the path of a file mask, fixed, only and creases may be said in words, as in `denoise_file`.

    Returns
    -------
    For arrays the new vertices, (n, 3), float32 if they came so; for an object a copy of it with its attributes; for a
    path the path of a new file beside it, `<stem>_denoised<suffix>`, as `denoise_file` writes it

    Raises
    ------
    MeshError : no valid mesh; ReadError, which is one, where a file cannot be read
    ParameterError : an unknown method or parameter, a value out of range, a mask of the wrong shape
    OutputError : the file to be written exists already, or cannot be written
    """
    controls = Controls(
        strength=strength,
        mask=mask,
        fixed=fixed,
        only=only,
        boundary=boundary,
        creases=creases,
        keep_detail=keep_detail,
        max_displacement=max_displacement,
        volume=volume,
        threads=threads,
        progress=progress,
    )
    chosen = find(method)
    isolate = _isolates(on_bad)
    with limit_threads(threads):
        if faces is not None:
            return _denoised(chosen, mesh, faces, parameters, controls, isolate=isolate)
        if isinstance(mesh, str | PathLike):
            done = _denoised_file(chosen, fspath(mesh), None, parameters, controls, force=False, isolate=isolate)
            return Path(done.output)
        if isinstance(mesh, Mesh):
            return mesh.moved(_denoised(chosen, mesh.vertices, mesh.faces, parameters, controls, isolate=isolate))
        return _denoised_object(chosen, mesh, parameters, controls, isolate=isolate)


def denoise_file(
    source: str | PathLike[str] | BinaryIO,
    output: str | PathLike[str] | BinaryIO | None = None,
    *,
    method: str = DEFAULT_METHOD,
    force: bool = False,
    parameters: dict[str, Any] | None = None,
    on_bad: OnBad = "error",
    **controls: Any,
) -> Report:
    """Denoise a mesh file; everything in it but positions and normals is kept.

    Parameters
    ----------
    source : path, or a stream of bytes
    output : path, whose extension decides on the format, or a stream; None is `<stem>_denoised<suffix>` beside the
        source
    method : one of `methods()`
    force : replace an existing file
    parameters : of the method
    on_bad : as in `denoise`; a bad face keeps its place in the file, with all that it holds
    controls : strength, mask, fixed, only, boundary, creases, keep_detail, max_displacement, volume, threads, progress
        as in `denoise`, over the vertices and triangles of `read(source).mesh`, bad ones included. In words, mask is a
        vertex attribute of the file (uint8 in 0 … 255, else 0 … 1) or a file .npy or .txt with one number for each
        vertex; fixed such an attribute, numbers of vertices like "0,5,7-20", or a file of them; only the name of a
        material, group, object or mesh, or kind=name, or several in a list; creases an angle, or a file with two
        vertices in each row. All of them count the vertices of the file from 0; where it splits a vertex at a seam, the
        smallest weight counts

    Raises
    ------
    ReadError, MeshError, ParameterError, OutputError : as in `denoise`; nothing is written then
    """
    known = [field.name for field in fields(Controls)]
    if unknown := [name for name in controls if name not in known]:
        raise ParameterError(
            f"there is no control {unknown[0]!r}; there are: {', '.join(known)} - parameters of the method go into "
            "`parameters`"
        )
    how = Controls(**controls)
    with limit_threads(how.threads):
        return _denoised_file(
            find(method), source, output, parameters or {}, how, force=force, isolate=_isolates(on_bad)
        )


def methods() -> dict[str, Method]:
    """Return every method by name, with its parameters, their units, ranges and defaults, and its source."""
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
    """Return `<stem>_<what><suffix>` in the folder of a mesh file; raises ReadError where that is a folder itself."""
    if source.is_dir():
        raise io.ReadError(f"{source} is a folder: give the name of a mesh file in it")
    return source.with_name(f"{source.stem}_{what}{source.suffix}")


def _isolates(on_bad: str) -> bool:
    """Tell whether bad vertices and faces are set aside; raises ParameterError where nothing of the kind is said."""
    if on_bad not in get_args(OnBad):
        raise ParameterError(f"on_bad is {on_bad!r}; it must be one of {', '.join(get_args(OnBad))}")
    return on_bad == "isolate"


def _denoised(
    method: Method,
    vertices: ArrayLike,
    faces: ArrayLike,
    parameters: dict[str, Any],
    controls: Controls,
    *,
    isolate: bool,
) -> NDArray[Any]:
    given = np.asarray(vertices)
    dtype = given.dtype if given.dtype.kind == "f" else np.dtype(np.float64)
    mesh = isolated(vertices, faces) if isolate else Mesh(vertices, faces)
    if isolate and controls.only is not None:  # counts the faces that the mesh is without as well
        left = ~bad_faces(vertices, faces)
        controls = replace(controls, only=faces_within(controls.only, len(left))[left])
    denoised = controlled(method, mesh, parameters, controls, dtype=dtype)
    return np.where(bad_vertices(given)[:, None], given, denoised) if isolate else denoised


def _denoised_object(
    method: Method, mesh: Any, parameters: dict[str, Any], controls: Controls, *, isolate: bool
) -> Any:
    """Denoise a mesh of another library, of which copies of vertices at seams stay together."""
    kind = adapter(mesh)
    vertices, faces = kind.arrays(mesh)
    within = ((faces >= 0) & (faces < len(vertices))).all(axis=1)
    named = faces.astype(np.int64)
    welds, first = weld(vertices, named[within])
    named[within] = welds[named[within]]
    denoised = _denoised(method, vertices[first], named, parameters, welded(controls, welds), isolate=isolate)[welds]
    return kind.with_vertices(mesh, np.where(denoised == vertices, vertices, denoised))  # -0 stays -0


def _denoised_file(
    method: Method,
    source: str | PathLike[str] | BinaryIO,
    output: str | PathLike[str] | BinaryIO | None,
    parameters: dict[str, Any],
    controls: Controls,
    *,
    force: bool,
    isolate: bool,
) -> Report:
    method.checked(parameters)
    if output is None:
        if not isinstance(source, str | PathLike):
            raise TypeError("a stream has no place for its output: give one")
        output = beside(Path(source), "denoised")
        check_output(output, force=force)
    elif isinstance(output, str | PathLike):
        check_output(Path(output), force=force)
        if not is_special(output):
            io.output_format(output)
    file = io.read(source).isolating() if isolate else io.read(source)
    format = io.output_format(output, file.format)
    check_target(file, output, format=format, force=force)
    mesh = mesh_of_file(file, source_name(source))
    given = {**controls.in_words(), "on_bad": "isolate" if isolate else "error"}
    controls = selected(controls, file)
    start = time.perf_counter()
    vertices = controlled(method, mesh, parameters, controls, dtype=file.positions.dtype)
    seconds = time.perf_counter() - start
    small, exponent = in_frame(without_lines(mesh))  # squares of lengths overflow where coordinates are huge
    with np.errstate(over="ignore"):
        limit = float(np.ldexp(framed_length("max_displacement", controls.max_displacement, small, exponent), exponent))
    try:
        left_out = io.write(file.with_vertices(vertices, limit=limit), output, format=format, force=force)
    except io.ReadError as error:  # of what only other formats need to know
        raise io.ReadError(f"{source_name(source)}: {error}") from error.__cause__
    moves = np.linalg.norm(np.ldexp(vertices - mesh.vertices, -exponent), axis=1)
    in_edges = moves / small.mean_edge_length if small.mean_edge_length > 0 else moves
    return Report(
        source=source_name(source),
        output=source_name(output),
        method=method.name,
        parameters=parameters,
        strength=controls.strength,
        controls=given,
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        isolated_vertices=int(file.bad_vertices.sum()),
        isolated_faces=int(file.left_out.sum()),
        moved=int((moves > 0).sum()),
        mean_displacement=float(in_edges.mean()),
        largest_displacement=float(in_edges.max()),
        seconds=seconds,
        left_out=tuple(left_out),
    )
