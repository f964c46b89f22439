"""Denoise several meshes whose walls coincide, such as segmented regions."""

from collections.abc import Iterable, Sequence
from contextlib import nullcontext
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
import scipy
from numpy.typing import ArrayLike

from cascadenorm.api.api import DEFAULT_METHOD
from cascadenorm.api.apply import Applied, run_with_controls
from cascadenorm.api.opened_files import DenoisingSummary, opened_file, written_file
from cascadenorm.api.seamless import SeamlessMesh
from cascadenorm.api.selection import weld_controls
from cascadenorm.compute.compile_time import Stopwatch
from cascadenorm.controls.weights import mask_weights, selected_vertices
from cascadenorm.errors import MeshError, OutputError, ParameterError
from cascadenorm.io.atomic import making_folder
from cascadenorm.mesh import Ints, Mesh, connected_components, first_of_each, limit_threads
from cascadenorm.registry import Method, find
from cascadenorm.registry.controls import CONTROLS, Controls, checked_controls, with_control_parameters

if TYPE_CHECKING:
    from typing_extensions import Unpack

COINCIDENCE_TOLERANCE = 2.0**-20  # share of the largest coordinate, more than single precision and six digits round
MAX_TOLERANCE_EDGES = 0.01  # upper limit of the tolerance in mean edge lengths, for meshes with large coordinates


@with_control_parameters
def denoise_regions(meshes: Iterable[Any], *, method: str = DEFAULT_METHOD, **parameters: Any) -> list[Any]:
    """Denoise meshes whose walls coincide, such as the regions of a segmentation; shared walls stay shared.

    Vertices of different meshes that coincide within rounding count as one vertex and move to exactly the same
    position. Meshes that share no vertex with another one are denoised as by `denoise`.

    Parameters
    ----------
    meshes
        Meshes of any kind that `denoise` accepts except paths. For files, use `denoise_region_files`.
    method
        Name of a method listed by `methods()`.
    parameters
        Parameters of the method.

    Controls with one value per vertex, face or edge are rejected here; `denoise_region_files` accepts names.

    Returns
    -------
    For each mesh, what `denoise` returns for it: new vertices for arrays, a copy for all other types

    Raises
    ------
    MeshError
        As in `denoise`.
    ParameterError
        As in `denoise`; also if a mesh is a path, or a control has one value per vertex, face or edge.
    """
    controls = checked_controls({name: parameters.pop(name) for name in CONTROLS if name in parameters})
    for name in ("mask", "fixed", "only", "creases"):
        given: Any = controls[name]
        if np.ndim(given) or isinstance(given, str | PathLike):
            raise ParameterError("applies to a single mesh, and several are given", parameter=name)
    meshes = list(meshes)
    for mesh in meshes:
        if isinstance(mesh, str | PathLike):
            raise ParameterError(f"{fspath(mesh)} is a path", hint="for files call denoise_region_files")
    every = [SeamlessMesh.of(mesh, isolate=controls["on_bad"] == "isolate") for mesh in meshes]
    with limit_threads(controls["threads"]):
        moved = _denoise_together(find(method), [Region(one.mesh, controls, one.dtype) for one in every], parameters)
    return [one.moved(of.vertices, controls) for one, of in zip(every, moved, strict=True)]


@with_control_parameters
def denoise_region_files(
    sources: str | PathLike[str] | Sequence[str | PathLike[str]],
    folder: str | PathLike[str] | None = None,
    *,
    method: str = DEFAULT_METHOD,
    force: bool = False,
    parameters: dict[str, Any] | None = None,
    **controls: "Unpack[Controls]",
) -> list[DenoisingSummary]:
    """Denoise mesh files whose walls coincide; each file keeps everything except positions and normals.

    Parameters
    ----------
    sources
        Path, or several of them.
    folder
        Folder for the outputs, which keep their file names. None writes `<stem>_denoised<suffix>` beside each source.
    method
        Name of a method listed by `methods()`.
    force
        Replace existing files.
    parameters
        Parameters of the method.

    Names in controls refer to each file separately.

    Returns
    -------
    A summary for each file; `seconds` is the time of all files together

    Raises
    ------
    ReadError, MeshError, ParameterError, OutputError, MissingDependencyError
        As in `denoise`.
    """
    every, chosen, given = checked_controls(controls), find(method), parameters or {}
    chosen.checked(given)
    paths = [sources] if isinstance(sources, str | PathLike) else list(sources)
    targets = [None if folder is None else Path(folder) / Path(path).name for path in paths]
    _check_targets(paths, targets)
    with limit_threads(every["threads"]), nullcontext() if folder is None else making_folder(Path(folder)):
        opened = [opened_file(s, t, every, force=force) for s, t in zip(paths, targets, strict=True)]
        watch = Stopwatch()
        regions = [Region(file.mesh, file.controls, file.file.positions.dtype) for file in opened]
        applied = _denoise_together(chosen, regions, given)
        seconds = watch.seconds()
        return [
            written_file(file, of, chosen, given, every, seconds=seconds, force=force).summary
            for file, of in zip(opened, applied, strict=True)
        ]


def _check_targets(paths: Sequence[str | PathLike[str]], targets: Sequence[Path | None]) -> None:
    """Raise OutputError if two files have one target, or are the same file if there are no targets."""
    owners: dict[Path, str] = {}
    for path, target in zip([fspath(path) for path in paths], targets, strict=True):
        place = Path(path) if target is None else target
        if place in owners:
            if target is None:
                raise OutputError(f"{path} is given twice")
            raise OutputError(f"{owners[place]} and {path} would both be written to {target}", hint="rename one")
        owners[place] = path


class Region(NamedTuple):
    """A mesh, the controls over its vertices and faces, and the floating type of its result."""

    mesh: Mesh
    controls: Controls
    dtype: np.dtype[Any]


def _denoise_together(method: Method, regions: Sequence[Region], parameters: dict[str, Any]) -> list[Applied]:
    """Denoise regions; those that share vertices are denoised together."""
    if not regions:
        raise MeshError("no meshes are given", hint="give at least one")
    out: dict[int, Applied] = {}
    first, groups = coincident_vertices([region.mesh for region in regions])
    owners = np.repeat(groups, [len(region.mesh.vertices) for region in regions])
    for group in np.unique(groups):
        mine, rows = np.flatnonzero(groups == group).tolist(), np.flatnonzero(owners == group)
        found = _denoise_group(method, [regions[i] for i in mine], np.searchsorted(rows, first[rows]), parameters)
        out |= dict(zip(mine, found, strict=True))
    return [out[i] for i in range(len(regions))]


def _denoise_group(method: Method, regions: Sequence[Region], first: Ints, parameters: dict[str, Any]) -> list[Applied]:
    """Denoise one group of regions; `first` maps each vertex to the first one it coincides with."""
    if len(regions) == 1:
        only = regions[0]
        return [run_with_controls(method, only.mesh, parameters, only.controls, dtype=only.dtype)]

    # Join the regions into one mesh of the coarsest type, so that every region can hold the result
    whole, vertices = join_meshes([region.mesh for region in regions], first)
    over = weld_controls(_concatenated(regions), vertices.astype(np.int32))
    coarsest = min((region.dtype for region in regions), key=lambda kind: kind.itemsize)
    applied = run_with_controls(method, whole, parameters, over, dtype=coarsest)
    moved, removed = applied.vertices, applied.removed

    # Distribute the vertices to the regions; unmoved vertices keep their own bits
    still = (moved == whole.vertices.astype(coarsest)).all(axis=1)
    ends = np.cumsum([len(region.mesh.vertices) for region in regions])[:-1]
    return [
        Applied.elsewhere(
            region.mesh,
            np.where(still[rows][:, None], region.mesh.vertices, moved[rows]).astype(region.dtype),
            None if removed is None else removed[rows],
            applied,
        )
        for region, rows in zip(regions, np.split(vertices, ends), strict=True)
    ]


def _concatenated(regions: Sequence[Region]) -> Controls:
    """Return the controls of all regions as controls of the concatenated mesh."""
    one = regions[0].controls.copy()
    if one["mask"] is not None:
        one["mask"] = np.concatenate([mask_weights(r.controls["mask"], len(r.mesh.vertices)) for r in regions])
    if one["fixed"] is not None:
        fixed = [selected_vertices("fixed", r.controls["fixed"], len(r.mesh.vertices)) for r in regions]
        one["fixed"] = np.concatenate(fixed)
    if one["only"] is not None:
        one["only"] = np.concatenate([np.asarray(region.controls["only"]) for region in regions])
    if np.ndim(cast(ArrayLike, one["creases"])):
        starts = np.cumsum([0, *(len(region.mesh.vertices) for region in regions)])
        pairs = [np.asarray(r.controls["creases"]) + start for r, start in zip(regions, starts, strict=False)]
        one["creases"] = np.concatenate(pairs)
    return one


def coincident_vertices(meshes: Sequence[Mesh]) -> tuple[Ints, Ints]:
    """Find the vertices of different meshes that coincide within rounding.

    Vertices of the same mesh are joined only if both coincide with a vertex of another mesh. Returns the (k,) first
    coincident vertex of each vertex, one mesh after the other; and the group of each mesh, where meshes with coincident
    vertices belong to the same group.
    """
    # Pairs of used vertices of different meshes within the tolerance
    counts = [len(mesh.vertices) for mesh in meshes]
    positions = np.concatenate([mesh.vertices for mesh in meshes])
    owner = np.repeat(np.arange(len(meshes)), counts)
    used = np.flatnonzero(np.concatenate([mesh.topology.used_vertices for mesh in meshes]))
    size = float(np.abs(positions[used]).max())
    tolerance = min(COINCIDENCE_TOLERANCE * size, MAX_TOLERANCE_EDGES * min(mesh.mean_edge_length for mesh in meshes))
    pairs = used[scipy.spatial.cKDTree(positions[used]).query_pairs(tolerance, output_type="ndarray")]
    pairs = pairs[owner[pairs[:, 0]] != owner[pairs[:, 1]]]

    # The first vertex of each connected set of pairs, and the connected meshes
    part = connected_components(pairs, len(positions))
    return first_of_each(part)[part], connected_components(owner[pairs], len(meshes)).astype(np.int64)


def join_meshes(meshes: Sequence[Mesh], first: Ints) -> tuple[Mesh, Ints]:
    """Join meshes at the (k,) first coincident vertices that `coincident_vertices` returns.

    The result has the faces of all meshes in order; coincident vertices occur once, at the position of the first.
    Returns as well its (k,) vertex for each vertex of the meshes, one mesh after the other.
    """
    kept = first == np.arange(len(first))
    vertices = (np.cumsum(kept) - 1)[first]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [vertices[start + mesh.faces] for start, mesh in zip(starts, meshes, strict=False)]
    positions = np.concatenate([mesh.vertices for mesh in meshes])
    return Mesh(positions[kept], np.concatenate(faces)), vertices
