"""One method, or another program, on one pair."""

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

NOISY = "noisy"
"""Name under which the input itself is measured."""


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """A method, or another program, on a pair.

    Parameters
    ----------
    seconds
        Of the method alone, compiled before; 0 for the noisy mesh itself and for results of other programs.
    memory_mb
        That it needed at most, in megabytes; None where that is not known.
    same_faces
        Whether the faces are those of the clean mesh; else each is compared with the nearest of them.
    """

    pair: str
    method: str
    measures: Measures
    seconds: float
    memory_mb: float | None
    same_faces: bool

    def row(self) -> dict[str, Any]:
        """Everything in one level, by the names in COLUMNS."""
        everything = {**vars(self), **vars(self.measures)}
        return {name: everything[name] for name in COLUMNS}


COLUMNS = ("pair", "method", *(field.name for field in fields(Measures)), "seconds", "memory_mb", "same_faces")
"""Names in a row of a result."""


class FailedRun(NamedTuple):
    """A pair, or a method on it, that could not be measured."""

    pair: str
    method: str | None
    error: Exception


class Run(NamedTuple):
    """What is to be done.

    Parameters
    ----------
    pair, name
        The files, and what the row is called.
    settings
        Of a method; None where it is none.
    command
        Words of a program; empty where it is none.
    timeout
        Seconds after which that is stopped.
    results
        Folder of meshes that another program made; None where it is none.
    records
        Where the mesh and its measures are kept, if anywhere.
    """

    pair: FilePair
    name: str
    settings: Mapping[str, Any] | None = None
    command: Sequence[str] = ()
    timeout: float = TIMEOUT_S
    results: Path | None = None
    records: Records | None = None


def run(task: Run) -> RunResult | FailedRun:
    """Do one run, or take it from the records; a pair that cannot be read is a failure without a method.

    Whatever a reader or a method ends in is listed, and the rest goes on; a folder of records that cannot be written
    ends the evaluation.
    """
    pair, name, records = task.pair, task.name, task.records
    try:
        noisy, clean = _meshes(pair)
    except Exception as error:  # a damaged file, or a package that is missing for its format
        return FailedRun(pair.name, None, error)
    try:
        file = result_file(task.results, pair) if task.results else None
        key = records.key(pair, name, task.settings, task.command, file) if records else ""
        known = records.known(pair, name, key) if records else None
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
            records.keep(pair, name, key, mesh, result.row())
    except OutputError:
        raise
    except Exception as error:
        return FailedRun(pair.name, name, error)
    return result


@lru_cache(maxsize=1)
def _meshes(pair: FilePair) -> tuple[Mesh, Mesh]:
    """The noisy and the clean mesh; those of the last pair are kept for its next method."""
    return as_mesh(pair.noisy), as_mesh(pair.clean)


def forget() -> None:
    """Free the meshes of the last pair."""
    _meshes.cache_clear()
    _warm.clear()


_warm: set[str] = set()
"""Methods that have run in this process."""


def _denoised(task: Run, noisy: Mesh, file: Path | None) -> tuple[Mesh, float, float | None]:
    """The mesh to be measured, and the seconds and the memory that it took."""
    if file is not None:
        return as_mesh(file), 0.0, None
    if task.command:
        return run_program(task.command, task.pair.noisy, timeout=task.timeout)
    if task.settings is None:
        return noisy, 0.0, None
    if task.name not in _warm:  # so that the times do not depend on what was compiled before
        with suppress(Exception):  # told where it happens to the whole
            denoise(Mesh(noisy.vertices, noisy.faces[:200]), method=task.name, **task.settings)
        _warm.add(task.name)
    fresh = Mesh(noisy.vertices, noisy.faces)  # topology is part of the work, for each method
    with peak_memory() as peak:
        start = time.perf_counter()
        mesh = denoise(fresh, method=task.name, **task.settings)
        seconds = time.perf_counter() - start
    return mesh, seconds, peak.megabytes


def _from_record(pair: str, name: str, row: Mapping[str, Any]) -> RunResult:
    measures = Measures(**{field.name: row[field.name] for field in fields(Measures)})
    others = {key: row[key] for key in ("seconds", "memory_mb", "same_faces")}
    return RunResult(pair=pair, method=name, measures=measures, **others)
