"""Run one method or another program on one pair."""

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cascadenorm.api.api import denoise
from cascadenorm.errors import OutputError
from cascadenorm.evaluation.programs import TIMEOUT_S, run_program
from cascadenorm.evaluation.records import Records
from cascadenorm.execution.memory import peak_memory
from cascadenorm.geometry.metrics import Measures, measure
from cascadenorm.io.interop import as_mesh
from cascadenorm.io.pairs import FilePair, result_file
from cascadenorm.mesh import Mesh

NOISY = "noisy"  # name of the row that measures the input itself


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """Result of a method or another program on a pair."""

    pair: str
    method: str
    measures: Measures
    # run time of the method, excluding compilation; 0 for the noisy mesh itself and for results of other programs
    seconds: float
    memory_mb: float | None  # peak memory in megabytes; None if unknown
    # whether the faces equal those of the clean mesh; otherwise, each face is compared with the nearest clean one
    same_faces: bool

    def row(self) -> dict[str, Any]:
        """Return all values in a flat dictionary, with the keys in COLUMNS."""
        everything = {**vars(self), **vars(self.measures)}
        return {name: everything[name] for name in COLUMNS}


COLUMNS = ("pair", "method", *(field.name for field in fields(Measures)), "seconds", "memory_mb", "same_faces")
"""Keys in the row of a result."""


class FailedRun(NamedTuple):
    """A pair, or a method on a pair, that could not be measured."""

    pair: str
    method: str | None
    error: Exception


class Run(NamedTuple):
    """Description of a run: a method, a program, or given results."""

    pair: FilePair
    name: str  # of the row
    settings: Mapping[str, Any] | None = None  # of a method; None for other runs
    command: Sequence[str] = ()  # words of a program's command; empty for other runs
    timeout: float = TIMEOUT_S  # seconds after which the program is stopped
    results: Path | None = None  # folder of meshes that another program made; None for other runs
    records: Records | None = None  # where the mesh and its measures are kept; None if they are not kept


def run_task(task: Run) -> RunResult | FailedRun:
    """Do one run, or reuse its record; an unreadable pair is a failure without a method.

    Errors of readers and methods are returned and do not stop the evaluation, but a folder of records that cannot be
    written does.
    """
    pair, name, records = task.pair, task.name, task.records
    try:
        noisy, clean = _meshes(pair)
    except Exception as error:  # a damaged file, or a missing package for its format
        return FailedRun(pair.name, None, error)
    try:
        file = result_file(task.results, pair) if task.results else None
        key = records.key(pair, name, task.settings, task.command, file) if records else ""
        known = records.load(pair, name, key) if records else None
        if known is not None:
            return _from_record(pair.name, name, known)
        mesh, seconds, memory = _denoised(task, noisy, file)
        same = np.array_equal(mesh.faces, clean.faces)
        result = RunResult(
            pair=pair.name,
            method=name,
            measures=measure(mesh, clean),
            seconds=seconds,
            memory_mb=memory,
            same_faces=same,
        )
        if records:
            records.save(pair, name, key, mesh, result.row())
    except OutputError:
        raise
    except Exception as error:
        return FailedRun(pair.name, name, error)
    return result


@lru_cache(maxsize=1)
def _meshes(pair: FilePair) -> tuple[Mesh, Mesh]:
    """Return the noisy and the clean mesh; those of the last pair are cached for its next method."""
    return as_mesh(pair.noisy), as_mesh(pair.clean)


def clear_caches() -> None:
    """Free the meshes of the last pair."""
    _meshes.cache_clear()
    _compiled.clear()


_compiled: set[str] = set()  # methods that have already run in this process


def _denoised(task: Run, noisy: Mesh, file: Path | None) -> tuple[Mesh, float, float | None]:
    """Return the mesh to measure, and the time in seconds and memory in megabytes that it took."""
    if file is not None:
        return as_mesh(file), 0.0, None
    if task.command:
        return run_program(task.command, task.pair.noisy, timeout=task.timeout)
    if task.settings is None:
        return noisy, 0.0, None
    if task.name not in _compiled:  # compile kernels before timing
        with suppress(Exception):  # errors are reported by the run on the whole mesh
            denoise(Mesh(noisy.vertices, noisy.faces[:200]), method=task.name, **task.settings)
        _compiled.add(task.name)
    fresh = Mesh(noisy.vertices, noisy.faces)  # the time of each method includes the topology
    with peak_memory() as peak:
        start = time.perf_counter()
        mesh = denoise(fresh, method=task.name, **task.settings)
        seconds = time.perf_counter() - start
    return mesh, seconds, peak.megabytes


def _from_record(pair: str, name: str, row: Mapping[str, Any]) -> RunResult:
    measures = Measures(**{field.name: row[field.name] for field in fields(Measures)})
    others = {key: row[key] for key in ("seconds", "memory_mb", "same_faces")}
    return RunResult(pair=pair, method=name, measures=measures, **others)
