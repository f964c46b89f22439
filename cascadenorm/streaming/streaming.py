"""Mesh files larger than memory, denoised patch by patch; an interrupted run resumes with the next one."""

import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.api.api import denoise
from cascadenorm.api.apply import controlled, in_words
from cascadenorm.api.denoised_files import DenoisingSummary
from cascadenorm.api.halo import check_local, check_local_controls
from cascadenorm.controls.settings import Controls, checked, takes_controls
from cascadenorm.errors import MeshError, OutputError, ParameterError
from cascadenorm.execution.cluster import LOCAL, folder_of_names
from cascadenorm.execution.cluster_map import on_cluster
from cascadenorm.execution.memory import PROCESS, memory_size
from cascadenorm.execution.process_map import Map
from cascadenorm.io.atomic import check_output, write_atomically
from cascadenorm.io.files import beside
from cascadenorm.mesh import Mesh, limit_threads, one_blas_thread, thread_count
from cascadenorm.registry import Method, find
from cascadenorm.streaming.guided import guided_steps
from cascadenorm.streaming.passes import Passes, Steps, View
from cascadenorm.streaming.patch_files import write_missing
from cascadenorm.streaming.ply_rows import ELSEWHERE, ply_tables
from cascadenorm.streaming.stages import LEARNED, learned_steps
from cascadenorm.streaming.stl_records import check_triangles, moved_records, welded
from cascadenorm.streaming.store import Store, StoredPatch
from cascadenorm.streaming.sweeps import WIDTH
from cascadenorm.version import __version__

if TYPE_CHECKING:
    from typing_extensions import Unpack

VERTEX, STAGED_VERTEX = 2000, 3000
"""Bytes of memory for each vertex of a patch, its part of the halo included; and of methods in stages."""

SMALLEST = 2000
"""Vertices of a patch at least; halos of smaller ones cost more than the patches."""

STAGED: Mapping[str, Callable[[Method, Mapping[str, Any]], Steps]] = {
    **dict.fromkeys(LEARNED, learned_steps),
    "guided-normal": guided_steps,
}
"""Methods that are done in passes: each step sees little of the mesh, all of them together too much."""

IN_MEMORY = ("mask", "fixed", "only")
"""Controls given as arrays over all vertices or faces."""


@takes_controls
def denoise_large_file(
    source: str | PathLike[str],
    output: str | PathLike[str] | None = None,
    *,
    memory: str | int,
    method: str,
    force: bool = False,
    parameters: dict[str, Any] | None = None,
    scheduler: str | None = None,
    **controls: "Unpack[Controls]",
) -> DenoisingSummary:
    """Denoise a mesh file that is larger than memory, in patches, to the same result as `denoise_file` in memory.

    The bytes are the same but for `auto`, `cascade` and `guided-normal`, for which sums over the whole are added in
    another order: these agree to 1e-6 of an edge. The patches lie in a folder beside the output while the work goes on,
    which takes some times the size of the file. A run that was interrupted goes on with the patch that it was at; at
    the end the folder is removed.

    Parameters
    ----------
    source : a binary PLY file of triangles, or a binary STL file
    output : as in `denoise_file`, a file in the same format
    memory : that a process should take, as bytes or as text like "4GB"; in this one up to 10 bytes for each vertex come
        on top
    method : "auto", "cascade", "guided-normal", or one whose receptive field docs/patches.md states: "taubin", …
    force, parameters : as in `denoise_file`
    scheduler : address of a Dask scheduler whose workers denoise the patches, or "local" for a cluster on this machine;
        they need the source and the folder of the output under the same names

    Returns
    -------
    What was done

    Raises
    ------
    ReadError : not such a file, or not valid; vertices split at seams
    ParameterError : a method or a control that sees more of the mesh than a patch
    OutputError : as in `denoise_file`
    MissingDependencyError, WorkerError : of the cluster
    """
    every, chosen, given = checked(controls), find(method), parameters or {}
    of_vertex = STAGED_VERTEX if method in STAGED else VERTEX
    at_once = max(SMALLEST, (memory_size("memory", memory) - PROCESS) // of_vertex)
    target = check_patches(source, output, chosen, given, every, force=force)
    steps = STAGED[method](chosen, given) if method in STAGED else None
    folder = _folder(target, _key(Path(source), chosen, given, every, steps))
    start = time.perf_counter()
    with limit_threads(every["threads"]), one_blas_thread(), _patch_by_patch(scheduler, source, target, given) as each:
        store, rings = _gathered(
            Path(source), folder, at_once, lambda groups: _rings(chosen, given, groups, every), steps is not None
        )
        if steps is not None:
            _denoise_in_stages(store, folder, chosen, steps, every, each)
        else:
            _denoise_patches(store, folder, method, given, every, rings, each)
        moved = _joined(store, folder)
    seconds = time.perf_counter() - start
    tables, whole = store.tables, store.whole
    pieces = moved_records(Path(source), tables, moved) if _is_stl(target) else tables.moved(moved)
    write_atomically(target, pieces, force=force)
    count, mean, largest = _moves(store, moved)
    del moved
    shutil.rmtree(folder)
    return DenoisingSummary(
        source=str(source),
        output=str(target),
        method=method,
        parameters=dict(given),
        strength=every["strength"],
        controls=in_words(every),
        vertices=tables.vertices.rows,
        faces=tables.faces.rows,
        isolated_vertices=0,
        isolated_faces=0,
        moved=count,
        mean_displacement=mean / whole.mean_edge_length,
        largest_displacement=largest / whole.mean_edge_length,
        seconds=seconds,
        error=None,
        left_out=(),
    )


def check_patches(
    source: str | PathLike[str],
    output: str | PathLike[str] | None,
    method: Method,
    parameters: Mapping[str, Any],
    controls: Controls,
    *,
    force: bool,
) -> Path:
    """Return where `denoise_large_file` writes, after what can be refused before the work.

    Raises
    ------
    ReadError, ParameterError, OutputError : as there
    """
    for name in IN_MEMORY:
        if controls[name] is not None:  # type: ignore[literal-required]
            raise ParameterError(
                "needs the whole mesh in memory",
                parameter=name,
                hint="leave it out, or denoise where the whole fits into memory",
            )
    if method.name in STAGED:
        STAGED[method.name](method, parameters)
    _rings(method, parameters, 1, controls)
    target = beside(Path(source), "denoised") if output is None else Path(output)
    check_output(target, force=force)
    stl = _is_stl(Path(source))
    if stl:
        check_triangles(Path(source))
    else:
        ply_tables(Path(source))
    if target.suffix.lower() != (".stl" if stl else ".ply"):
        raise OutputError(f"{target} is not a {'.stl' if stl else '.ply'} file, as {source}: patches keep the format")
    return target


def _rings(method: Method, parameters: Mapping[str, Any], groups: int, controls: Controls) -> int:
    """Return the width of the widest halo.

    Raises
    ------
    ParameterError : a method or a control that sees more of the mesh than a patch
    """
    if method.name not in STAGED:
        return check_local(method, parameters, groups, controls)
    check_local_controls(controls)
    return max(WIDTH, groups + 2)


def _is_stl(path: Path) -> bool:
    return path.suffix.lower() == ".stl"


def _gathered(
    source: Path, folder: Path, at_once: int, rings_of: Callable[[int], int], normals: bool
) -> tuple[Store, int]:
    """Return the mesh of a file on disk, and the receptive field.

    Parameters
    ----------
    at_once : vertices that are held in memory
    rings_of : from the number of groups of the vertex update to the receptive field
    normals : whether the method depends on the normals even where the receptive field does not depend on the groups

    Raises
    ------
    MeshError : one that has to be denoised in memory; nothing is left in the folder then
    """
    try:
        store = Store(welded(source, folder, 3 * at_once) if _is_stl(source) else ply_tables(source), folder)
        whole = store.gather(at_once, lambda groups: _patch_size(at_once, rings_of(groups)))
        rings = rings_of(whole.groups)
        if whole.single_sided and (normals or rings != rings_of(whole.groups + 1)):
            single = MeshError("a part of the surface cannot be oriented, like a Möbius strip", hint=ELSEWHERE)
            raise single.within(str(source))
    except MeshError:
        shutil.rmtree(folder)
        raise
    return store, rings


def _patch_size(at_once: int, rings: int) -> int:
    """Return the vertices of a patch that has so many, and no less than SMALLEST, once its halo is around it.

    Rings are about as wide as the square root of the vertices in a square: 1 edge has 0.87 of its square.
    """
    width = max(0.0, at_once**0.5 - 2 * rings)
    return max(SMALLEST, int(width**2))


def _key(source: Path, method: Method, parameters: Mapping[str, Any], controls: Controls, steps: Steps | None) -> str:
    """Return a digest of all that patches depend on; the source counts by its size and time of change."""
    state = os.stat(source)
    settings = {**method.checked(parameters), **in_words(controls), "strength": controls["strength"]}
    parts = [__version__, method.name, settings, state.st_size, state.st_mtime_ns, str(source.resolve())]
    if steps is not None:
        parts.append(steps.weights)
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()


def _folder(target: Path, key: str) -> Path:
    """Return the folder of the patches, empty unless it is of an interrupted run of the same work."""
    folder = target.with_name(f".{target.name}.parts")
    mark = folder / "key"
    try:
        if not (mark.exists() and mark.read_text(encoding="ascii") == key):
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            write_atomically(mark, [key.encode()])
    except OSError as error:
        raise OutputError(f"{folder} cannot be created: {error.strerror or error}") from error
    return folder


@contextmanager
def _patch_by_patch(
    scheduler: str | None, source: str | PathLike[str], target: Path, parameters: Mapping[str, Any]
) -> Iterator[Map]:
    """Return what does work on patches: this process, one after the other, or the workers of a cluster."""
    if scheduler is None:
        yield map
        return
    workers = thread_count() if scheduler == LOCAL else 1
    with on_cluster(scheduler, workers=workers, folder=folder_of_names([source, target], parameters.values())) as each:
        yield each


def _patch_files(store: Store, folder: Path) -> list[Path]:
    return [folder / f"patch_{number}.bin" for number in range(store.whole.patches)]


def _denoise_patches(
    store: Store, folder: Path, method: str, parameters: Mapping[str, Any], controls: Controls, rings: int, each: Map
) -> None:
    """Denoise the patches."""
    settings: dict[str, Any] = {name: controls[name] for name in ("strength", "boundary", "max_displacement")}

    def denoised(_: int, stored: StoredPatch) -> NDArray[Any]:
        patch = stored.patch
        return denoise(stored.positions, patch.faces, method=method, halo=patch.halo, **parameters, **settings)

    paths = _patch_files(store, folder)
    for done in write_missing(paths, partial(_moved_rows, store, rings, denoised), each):
        if controls["progress"] is not None:
            controls["progress"](done / len(paths))


def _denoise_in_stages(store: Store, folder: Path, method: Method, steps: Steps, controls: Controls, each: Map) -> None:
    """Do the passes of a method in stages, then move the vertices of each patch under the controls."""
    progress = controls["progress"]
    place = steps.take(Passes(store, folder, each, progress, steps.cost))
    without: Controls = {**controls, "progress": None}

    def denoised(number: int, stored: StoredPatch) -> NDArray[Any]:
        view = View(store, number, stored)
        known = replace(method, function=lambda mesh: place(view), rings=lambda given, groups: 1)
        mesh = Mesh(stored.positions, stored.patch.faces)
        settings: Controls = {**without, "halo": stored.patch.halo}
        return controlled(known, mesh, {}, settings, dtype=stored.positions.dtype)

    for _ in write_missing(_patch_files(store, folder), partial(_moved_rows, store, 1, denoised), each):
        pass
    if progress is not None:
        progress(1.0)


def _moved_rows(store: Store, rings: int, denoised: Callable[[int, StoredPatch], NDArray[Any]], number: int) -> bytes:
    """Return the vertices of a patch with their new positions; one without faces stays.

    Parameters
    ----------
    rings : width of the halo
    denoised : returns the positions of the vertices of a patch, by its number and what is stored of it, (k, 3)
    """
    stored = store.patch(number, rings)
    patch = stored.patch
    positions = denoised(number, stored) if len(stored.own_faces) else stored.positions
    rows = np.empty(len(patch.inside), store.moved_kind)
    rows["id"], rows["xyz"] = patch.inside, positions[~patch.halo.vertices]
    return rows.tobytes()


def _joined(store: Store, folder: Path) -> NDArray[Any]:
    """Return the positions of all vertices, (n, 3), in a file that is mapped into memory."""
    shape = store.tables.vertices.rows, 3
    moved = np.memmap(folder / "moved.bin", store.moved_kind["xyz"].base, "w+", shape=shape)
    numbers = store.numbers
    for path in _patch_files(store, folder):
        rows = np.fromfile(path, store.moved_kind)
        moved[rows["id"] if numbers is None else numbers[rows["id"]]] = rows["xyz"]
    return moved


def _moves(store: Store, moved: NDArray[Any]) -> tuple[int, float, float]:
    """Return how many vertices moved, and by how much on average and at most, in the frame."""
    count, total, largest = 0, 0.0, 0.0
    for first, before in store.tables.positions():
        after = moved[first : first + len(before)].astype(np.float64)
        moves = np.linalg.norm(np.ldexp(after - before.astype(np.float64), -store.whole.frame.exponent), axis=1)
        count += int((moves > 0).sum())
        total += float(moves.sum())
        largest = max(largest, float(moves.max()))
    return count, total / len(moved), largest
