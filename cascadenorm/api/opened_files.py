"""Read mesh files, write them with new vertices, and summarize the change."""

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from glob import has_magic
from os import PathLike, fspath
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cascadenorm import io
from cascadenorm.api.apply import Applied, reported_controls
from cascadenorm.api.dropped_components import Dropped, controls_of_kept, without_small_components
from cascadenorm.api.selection import resolve_controls
from cascadenorm.controls.detail import as_unknown_surface
from cascadenorm.controls.displacement import framed_length
from cascadenorm.detection.error_kind import ErrorKind, error_kind
from cascadenorm.errors import MissingDependencyError, OutputError, ParameterError, ReadError, counted
from cascadenorm.geometry.small_components import component_limit
from cascadenorm.io.atomic import check_output, is_special
from cascadenorm.io.base import Piece
from cascadenorm.io.files import Source, beside, check_extension, check_source, check_stream, check_target, is_url
from cascadenorm.io.interop import mesh_of_file, source_name
from cascadenorm.learned.methods import MeshTreatment, mesh_treatment
from cascadenorm.mesh import Floats, Mesh, in_frame, row_lengths, without_lines
from cascadenorm.mesh.welding import nearly_coincident
from cascadenorm.registry import Method
from cascadenorm.registry.controls import Controls, parsed_length


@dataclass(frozen=True, kw_only=True)
class DenoisingSummary:
    """Summary of how a file was denoised.

    Parameters
    ----------
    source, output
        Names of the files or streams.
    method, parameters
        Method that was applied, and its parameters as given.
    strength
        Strength as given.
    controls
        Other controls that affect the result, as given; arrays are described by their shape.
    vertices, faces
        Counts; vertices that the file splits at seams count once.
    isolated_vertices, isolated_faces
        Numbers of vertices that are not finite and of other bad faces, which were left unchanged.
    nearly_coincident
        Number of boundary vertices within 0.001 median edge lengths of another vertex but not joined with it.
    moved
        Number of vertices whose position changed.
    mean_displacement, largest_displacement
        Over all vertices, in mean edge lengths.
    seconds
        Time of the method, excluding reading, writing and the compilation of kernels in a first run.
    error
        Kind of error of the mesh, independent of strength and limits; None for methods other than `auto`, or if no
        vertex was to be moved.
    treated_as
        Kind of surface that `auto` chose for the mesh; None for other methods.
    closed_surfaces, changed_volumes
        Numbers of closed components and shells of regions, and of those whose volume changed by more than 0.01 %; None
        unless the volume was to be kept.
    left_out
        Content of the source that the output format cannot hold, in words.
    weld, drop_components
        As given.
    dropped_components, dropped_faces
        Numbers of small components, and of their faces, that were dropped on request.
    components
        Number of connected components before that; None if none were to be dropped.
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
    treated_as: MeshTreatment | None
    left_out: tuple[str, ...]
    closed_surfaces: int | None = None
    changed_volumes: int | None = None
    nearly_coincident: int = 0
    weld: float | str | None = None
    drop_components: str | int | None = None
    dropped_components: int = 0
    dropped_faces: int = 0
    components: int | None = None

    @property
    def left_unchanged(self) -> str:
        """Isolated vertices and faces in words; empty if there are none."""
        vertices = counted(self.isolated_vertices, "vertex that is not finite", "vertices that are not finite")
        faces = counted(self.isolated_faces, "bad face")
        counts = (self.isolated_vertices, vertices), (self.isolated_faces, faces)
        return ", ".join(text for count, text in counts if count)

    @property
    def volume_not_kept(self) -> str:
        """Why the volume was not kept although it was to be, in words; otherwise empty."""
        if self.closed_surfaces == 0 and self.moved:
            return "the volume was not kept: no component of the mesh is closed"
        if not self.changed_volumes:
            return ""
        which = f"{self.changed_volumes} of {counted(self.closed_surfaces or 0, 'closed surface')}"
        return f"the volume of {which} was not kept: fixed vertices or the limit of displacements prevent it"

    @property
    def remedies(self) -> str:
        """What removes more if `auto` found no significant error, in words; otherwise empty."""
        if self.error is None or self.error.kind != "none":
            return ""
        remedies = ["auto found no significant error" if self.moved else "auto found no error and moved no vertex"]
        treated = self.treated_as
        if treated is not None and treated.treatment == "vertex-noise" and not treated.given:
            remedies.append("if the mesh was remeshed after a scan or a segmentation, set treat_as=measured-surface")
        remedies.append("a strength above 1, the removal of detail or another method removes what it takes for shape")
        return "; ".join(remedies)


class Denoised(NamedTuple):
    """Summary of how a file was denoised, with the file before and after."""

    summary: DenoisingSummary
    before: io.MeshFile
    after: io.MeshFile
    applied: Applied

    @property
    def seen(self) -> tuple[Mesh, Mesh]:
        """`Applied.seen` with the vertices before and after; faults are counted faster there than in a poor order."""
        return self.applied.seen_with(self.before.mesh.vertices), self.applied.seen_with(self.after.mesh.vertices)


class Opened(NamedTuple):
    """A file that was read, and the target it will be written to."""

    source: Source
    output: Source
    format: str  # of the output
    file: io.MeshFile
    mesh: Mesh
    controls: Controls  # over the mesh; names that refer to the file are resolved
    dropped: Dropped
    weld: float | str | None = None  # as given
    drop_components: str | int | None = None  # as given


def opened_file(
    source: Source,
    output: Source | None,
    controls: Controls,
    *,
    format: str | None = None,
    drop_components: str | int | None = None,
    force: bool,
    weld: float | str | None = None,
) -> Opened:
    """Read a file to be denoised, after all checks that do not need its content, and join vertices within `weld`."""
    _check_single(source)
    apart, in_edges = parsed_length("weld", weld) if weld is not None else (0.0, False)
    if drop_components is not None:
        component_limit(drop_components)  # raises ParameterError for an invalid limit
    output = _checked_output(source, output, format, force=force)
    file = io.read(source)
    if controls["on_bad"] == "isolate":
        file = file.isolating()
    unwelded = file
    if apart > 0:
        file = _welded(file, apart, in_edges, source_name(source))
    chosen = io.output_format(output, format or file.format)
    whole, dropped = file, Dropped(file)
    if drop_components is not None:
        dropped = without_small_components(file, drop_components, source_name(source))
        file = dropped.file
    check_target(file, output, format=chosen, force=force)
    mesh = mesh_of_file(file, source_name(source), may_isolate=True)
    resolved = resolve_controls(controls, unwelded, whole if apart > 0 else None)
    resolved = controls_of_kept(resolved, dropped, whole)
    return Opened(source, output, chosen, file, mesh, resolved, dropped, weld, drop_components)


def moved_file(file: io.MeshFile, vertices: Floats, mesh: Mesh, controls: Controls) -> io.MeshFile:
    """Return the file with new vertices of its mesh, (n, 3), within the displacement limit of the controls."""
    limit = framed_length("max_displacement", controls["max_displacement"], without_lines(mesh), 0)
    return file.with_vertices(vertices, limit=limit)


def _welded(file: io.MeshFile, distance: float, in_edges: bool, name: str) -> io.MeshFile:
    """Return a file with nearby boundary vertices joined; raises ParameterError for half an edge length or more."""
    edge = mesh_of_file(file, name, may_isolate=True).mean_edge_length
    if in_edges:
        distance *= edge
    if not distance < 0.5 * edge:
        raise ParameterError(
            f"is {distance:g}; it must be below half the mean edge length, {0.5 * edge:g}", parameter="weld"
        )
    return file.welding(distance)


def written_file(
    opened: Opened,
    applied: Applied,
    method: Method,
    parameters: dict[str, Any],
    controls: Controls,
    *,
    seconds: float,
    force: bool,
    others: Mapping[Path, Iterable[Piece]] | None = None,
) -> Denoised:
    """Write a file with new vertices of its mesh, and return the summary with the controls as the caller gave them.

    `others` are the contents of further files, which are written with it or not at all.
    """
    source, output, file, mesh = opened.source, opened.output, opened.file, opened.mesh

    try:
        # formats with integer coordinates round within the limit
        moved = moved_file(file, applied.vertices, mesh, controls)
        left_out = io.write(moved, output, format=opened.format, force=force, others=others)
    except ReadError as error:  # a fault of the source that only some output formats detect
        raise error.within(source_name(source)) from error.__cause__

    lengths = row_lengths(np.ldexp(applied.vertices - mesh.vertices, -applied.exponent))
    edge = applied.seen.mean_edge_length
    in_edges = lengths / edge if edge > 0 else lengths
    whole = without_lines(mesh)  # repeated faces, which `seen` lacks, are no boundary for `inspect` and `weld`
    near = nearly_coincident(applied.seen if len(applied.seen.faces) == len(whole.faces) else in_frame(whole)[0])
    closed, changed = (None, None) if controls["volume"] is None else applied.changed_volumes(mesh.vertices)
    summary = DenoisingSummary(
        source=source_name(source),
        output=fspath(output) if isinstance(output, str | PathLike) else str(getattr(output, "name", "the stream")),
        method=method.name,
        parameters=parameters,
        strength=controls["strength"],
        controls=reported_controls(controls),
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        isolated_vertices=int(file.bad_vertices.sum()),
        isolated_faces=int(file.left_out.sum()),
        moved=int((lengths > 0).sum()),
        mean_displacement=float(in_edges.mean()),
        largest_displacement=float(in_edges.max()),
        seconds=seconds,
        **detected_error(method, applied, parameters),
        left_out=tuple(dict.fromkeys([*opened.dropped.left_out, *left_out])),
        closed_surfaces=closed,
        changed_volumes=changed,
        nearly_coincident=int(near.sum()),
        weld=opened.weld,
        drop_components=opened.drop_components,
        dropped_components=opened.dropped.components,
        dropped_faces=opened.dropped.faces,
        components=opened.dropped.among,
    )
    applied.seen.forget_geometry()
    return Denoised(summary, file, moved, applied)


def detected_error(method: Method, applied: Applied, parameters: dict[str, Any]) -> dict[str, Any]:
    """Classify the error of a mesh as `inspect` does, and return the kind of surface that `auto` chose.

    The displacements by the method alone decide, because strength and limits do not change the error.
    """
    if applied.denoised is None:
        return {"error": None, "treated_as": None}
    chosen = as_unknown_surface(method, parameters) if applied.is_cut else parameters
    treated_as = mesh_treatment(applied.surfaces, width=applied.width, **method.with_defaults(chosen))
    treatment = None if treated_as is None else treated_as.treatment
    measured = None if treatment in (None, "unknown") else treatment != "vertex-noise"
    return {
        "error": error_kind(applied.seen, applied.denoised, exponent=applied.exponent, measured=measured),
        "treated_as": treated_as,
    }


def _check_single(source: Source) -> None:
    """Raise ReadError if a source is not a single local file; batch processing accepts the other kinds."""
    if not isinstance(source, str | PathLike):
        return
    name = fspath(source)
    batch = "`cascadenorm batch` or, in Python, denoise_files"
    if is_url(name):
        raise ReadError(f"{name} is a URL, and only local files can be denoised one at a time", hint=f"use {batch}")
    if os.path.isdir(name):
        hint = f"give the name of a mesh file in it, or for all of them use {batch}"
        raise ReadError(f"{name} is a folder", hint=hint)
    if has_magic(str(name)) and not os.path.lexists(name):
        hint = f"check the name; if it is a pattern for many files, use {batch}"
        raise ReadError(f"{name} does not exist", hint=hint)


def _check_format(source: Source, output: str | PathLike[str]) -> None:
    """Raise OutputError if the format of an output cannot be written; for the format of the source, first read that."""
    try:
        check_extension(source, output)
    except (OutputError, MissingDependencyError):
        if isinstance(source, str | PathLike) and Path(source).suffix.lower() == Path(output).suffix.lower():
            io.read(source)  # a format that cannot be read either is the fault of the source
        raise


def _checked_output(source: Source, output: Source | None, format: str | None, *, force: bool) -> Source:
    """Return the target to write to; raises OutputError if it cannot be written or may not be replaced."""
    if output is None:
        if not isinstance(source, str | PathLike):
            check_source(source)
            raise TypeError("a stream has no folder for the output: give an output")
        output = beside(Path(source), "denoised")
        check_output(output, force=force)
    elif isinstance(output, str | PathLike):
        check_output(Path(output), force=force)
        if not is_special(output):
            _check_format(source, output)
    else:
        check_stream(output)
        if format is not None:
            io.output_format(output, format)
    return output
