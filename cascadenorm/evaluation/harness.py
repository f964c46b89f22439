"""Run methods on pairs of noisy and clean meshes and measure the results."""

import math
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from cascadenorm.api.api import check_weights
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.errors import ParameterError, ReadError
from cascadenorm.evaluation.programs import TIMEOUT_S, checked_command
from cascadenorm.evaluation.records import Records, folder_name
from cascadenorm.evaluation.runs import COLUMNS, NOISY, FailedRun, Run, RunResult, clear_caches, run_task
from cascadenorm.execution.cluster import LOCAL_CLUSTER, required_folder, use_cluster
from cascadenorm.execution.process_map import parallel_map
from cascadenorm.execution.progress import Progress, no_progress
from cascadenorm.geometry.metrics import Measures
from cascadenorm.io.interop import as_mesh, save_mesh
from cascadenorm.io.pairs import FilePair, Paths, find_pairs
from cascadenorm.registry import checked_names, checked_number, find
from cascadenorm.registry.controls import checked_controls

__all__ = ["COLUMNS", "DEFAULT_METHODS", "NOISY", "Evaluation", "FailedRun", "RunResult", "evaluate"]

MEAN = "mean"  # name of the row of means among the pairs

DEFAULT_METHODS = ("auto", "cascade", "bilateral-normal", "guided-normal", "l0")


class Evaluation(NamedTuple):
    """Measurements of all pairs and methods, and the failures."""

    results: list[RunResult]
    failures: list[FailedRun]
    pairs: Sequence[FilePair] = ()  # files of each pair
    records: Records | None = None  # records in which the meshes are kept; None if they are not kept

    @property
    def methods(self) -> list[str]:
        """Names of the rows in order, starting with the noisy mesh."""
        return list(dict.fromkeys(result.method for result in self.results))

    @property
    def seeds(self) -> dict[str, int]:
        """Noise seed by pair name, for pairs that have one."""
        return {pair.name: pair.seed for pair in self.pairs if pair.seed is not None}

    @property
    def partial(self) -> set[str]:
        """Names of rows that lack results for some pairs and are therefore averaged over fewer pairs."""
        counts = Counter(result.method for result in self.results)
        return {name for name in counts if counts[name] < max(counts.values())}

    @property
    def means(self) -> list[RunResult]:
        """Mean of each method over the pairs that have a value."""
        return [_mean(name, [result for result in self.results if result.method == name]) for name in self.methods]


def evaluate(
    folders: Paths | Iterable[FilePair | str | PathLike[str]],
    *,
    methods: str | Sequence[str] = DEFAULT_METHODS,
    results: Mapping[str, str | PathLike[str]] | None = None,
    commands: Mapping[str, str] | None = None,
    timeout: float = TIMEOUT_S,
    parameters: Mapping[str, Any] | None = None,
    strength: float = 1.0,
    threads: int | None = None,
    noise: float | None = None,
    seeds: int = 1,
    keep: str | PathLike[str] | None = None,
    workers: int = 1,
    scheduler: str | None = None,
    progress: Progress = no_progress,
) -> Evaluation:
    """Denoise the noisy mesh of each pair by each method and measure the result against the clean mesh.

    Parameters
    ----------
    folders
        One or several folders. Each holds a pair, `noisy.*` and `clean.*`, or several pairs. Pairs as returned by
        `public_pairs` are also accepted.
    methods
        One or several names of methods. The noisy mesh always comes first.
    results
        Results of other programs: the name of each program and its folder, with a mesh `<pair>.*` for each pair.
    commands
        Other programs to run: the name of each and its command line. The placeholders {in} and {out} stand for the
        files, and {in.obj} and {out.obj} for files of that format. No shell is involved.
    timeout
        Seconds after which such a program is stopped.
    parameters
        Parameters that are passed to every method.
    strength, threads
        As in `denoise`.
    noise
        Standard deviation of Gaussian noise along the normals, in mean edge lengths, which is added to the clean meshes
        and replaces the noisy ones. None uses the noisy meshes of the pairs.
    seeds
        Number of noisy meshes per clean mesh; the tables then include the spread over seeds.
    keep
        Folder for the meshes and their measures. Results of an earlier run with the same files, settings, weights and
        version are reused.
    workers
        Number of processes. Several processes use one thread each, and run times then depend on the load. In a script,
        they require `if __name__ == "__main__":`, because they import the script.
    scheduler
        Address of the scheduler of a Dask cluster whose workers can access the same files; "local" starts a cluster of
        `workers` processes on this machine; None starts processes without Dask.
    progress
        Called with (task, parts done, total parts, next step).

    Returns
    -------
    Results ordered by pair, then by methods, results and commands. Failures and missing results are listed and do not
    stop the evaluation

    Raises
    ------
    ParameterError
        A method, program or parameter does not exist, a value is out of range, a program has the name of a method,
        `keep` is the folder of the pairs, or no scheduler answers at the address.
    WorkerError
        A process or a worker of a cluster ended before its work was done.
    ReadError
        There are no pairs, a folder of results is missing, a pair is named "mean", several given pairs have the same
        name or names that differ in slashes and underscores only, or several folders have the same name and results
        are given.
    """
    checked_controls({"strength": strength, "threads": threads})  # raises an error for values out of range
    methods = [methods] if isinstance(methods, str) else methods
    results, commands = checked_names("results", results), checked_names("commands", commands)
    for name in methods:
        check_weights(name, find(name).checked(parameters or {}))
    programs = {name: checked_command(name, command) for name, command in commands.items()}
    workers = checked_number("workers", int, workers, minimum=1)
    timeout = checked_number("timeout", float, timeout, above=0)
    noise = checked_number("noise", float | None, noise, minimum=0, below=math.inf)
    seeds = checked_number("seeds", int, seeds, minimum=1)
    if noise is None and seeds > 1:
        raise ParameterError(f"is {seeds}; it must be 1 without noise", parameter="seeds")
    if noise is not None and keep is None and scheduler not in (None, LOCAL_CLUSTER):
        raise ParameterError("must be a folder that all workers see: the noisy meshes go there", parameter="keep")
    pairs = _pairs(folders)
    if keep is not None:
        _check_keep(Path(keep), pairs)
    places = {name: Path(place) for name, place in results.items()}
    _check_names([*places, *programs], methods)
    _check_results(places, pairs)
    settings = {"strength": strength, "threads": threads, **(parameters or {})}
    rows: dict[str, dict[str, Any]] = {
        NOISY: {},
        **{name: {"settings": settings} for name in methods},
        **{name: {"results": place} for name, place in places.items()},
        **{name: {"command": words, "timeout": timeout} for name, words in programs.items()},
    }
    with TemporaryDirectory() as scratch:
        failures: list[FailedRun] = []
        if noise is not None:
            pairs, failures = with_noise(pairs, Path(keep or scratch) / "noise", level=noise, seeds=seeds)
        done = Evaluation([], failures, pairs, Records(Path(keep)) if keep is not None else None)
        runs = [Run(pair, name, records=done.records, **row) for pair in pairs for name, row in rows.items()]
        with use_cluster(scheduler, workers=workers, folder=_required_folder(runs)):
            _collect_results(runs, done, workers, progress)
    return done


def with_noise(
    pairs: Sequence[FilePair], folder: Path, *, level: float, seeds: int
) -> tuple[list[FilePair], list[FailedRun]]:
    """Write noisy versions of each clean mesh to a folder, with Gaussian noise along the normals.

    The level is the standard deviation of the noise, in mean edge lengths of the clean mesh. There are noisy meshes for
    the seeds 0, 1, …; the same seed always gives the same file. Returns the new pairs, and a failure for each pair
    with an unreadable clean mesh.
    """
    made: list[FilePair] = []
    failures: list[FailedRun] = []
    for pair in pairs:
        try:
            clean = as_mesh(pair.clean)
        except Exception as error:  # a damaged file, or a missing package for its format
            failures.append(FailedRun(pair.name, None, error))
            continue
        place = folder / folder_name(pair.name)
        place.mkdir(parents=True, exist_ok=True)
        for seed in range(seeds):
            name = f"{pair.name}-seed{seed}"
            noise = displacements(clean, "normal", level=level, rng=np.random.default_rng(seed))
            file = place / f"noisy-{level:g}-{seed}.ply"
            save_mesh(file, clean.moved(clean.vertices + noise), force=True)
            made.append(FilePair(name, file, pair.clean, seed))
    return made, failures


def _required_folder(runs: Sequence[Run]) -> str | None:
    """Return the folder in which workers must run because file names are relative; None if all are absolute."""
    places: set[Path | None] = set()
    values: list[object] = []
    for task in runs:
        places |= {task.pair.noisy, task.pair.clean, task.results, task.records and task.records.folder}
        values += [*(task.settings or {}).values(), *task.command]
    return required_folder(filter(None, places), values)


def _pairs(folders: Paths | Iterable[FilePair | str | PathLike[str]]) -> list[FilePair]:
    given = [folders] if isinstance(folders, str | PathLike) else list(folders)
    pairs = [one for one in given if isinstance(one, FilePair)]
    others = [one for one in given if not isinstance(one, FilePair)]
    pairs += find_pairs(others)
    if not pairs:
        raise ReadError("there are no pairs to evaluate")
    for name, count in Counter(pair.name for pair in pairs).items():
        if count > 1:
            raise ReadError(f"{count} pairs are named {name}: rename one, since results are listed by name")
        if name == MEAN:
            raise ReadError(f"a pair is named {name}: rename it, since the means are listed by this name")
    folders_of: dict[str, str] = {}
    for pair in pairs:
        other = folders_of.setdefault(folder_name(pair.name), pair.name)
        if other != pair.name:
            raise ReadError(f"the results of the pairs {other} and {pair.name} belong into one folder: rename one")
    return pairs


def _collect_results(runs: Sequence[Run], done: Evaluation, workers: int, progress: Progress) -> None:
    """Do the runs and collect their results; a pair that cannot be read is listed once."""
    unread: set[str] = set()
    try:
        with parallel_map(workers) as each:
            found = each(run_task, runs)
            for number, task in enumerate(runs):
                progress("evaluating", number, len(runs), f"{task.pair.name}: {task.name}")
                out = next(found)
                if isinstance(out, RunResult):
                    done.results.append(out)
                elif out.method is not None or out.pair not in unread:
                    unread |= {out.pair} if out.method is None else set()
                    done.failures.append(out)
    finally:
        clear_caches()
    progress("evaluating", len(runs), len(runs))


def _check_keep(keep: Path, pairs: Sequence[FilePair]) -> None:
    """Reject a folder that contains the folders of pairs, whose noisy meshes would be overwritten."""
    for pair in pairs:
        if pair.noisy.resolve().parent.parent == keep.resolve():
            problem = f"is {keep}, the folder of the pair {pair.name}"
            raise ParameterError(problem, parameter="keep", hint="name another folder")


def _check_names(names: Sequence[str], methods: Sequence[str]) -> None:
    """Reject names that are used twice or are not valid as file names."""
    for number, name in enumerate(names):
        if name in (NOISY, *methods):
            raise ParameterError(f"the results {name!r} have the name of a method: choose another name")
        if name in names[:number]:
            raise ParameterError(f"two rows are named {name!r}: rename one")
        if Path(name).name != name:
            raise ParameterError(f"the results are named {name!r}, which is not a file name: choose another name")


def _check_results(places: Mapping[str, Path], pairs: Sequence[FilePair]) -> None:
    """Reject missing folders of results, and pairs that cannot be distinguished by name."""
    for place in places.values():
        if not os.path.isdir(place):
            raise ReadError(f"{place} is not a folder: give one that holds a mesh <pair>.* for each pair")
        twice = [pair.name for pair in pairs if Path(pair.name).name != pair.name]
        if twice:
            raise ReadError(
                f"several pairs are named {Path(twice[0]).name}: rename one, since results are stored by name"
            )


def _mean(method: str, results: Sequence[RunResult]) -> RunResult:
    means = {
        field.name: _average([getattr(result.measures, field.name) for result in results]) for field in fields(Measures)
    }
    return RunResult(
        pair=MEAN,
        method=method,
        measures=Measures(**means),  # type: ignore[arg-type]
        seconds=sum(result.seconds for result in results) / len(results),
        memory_mb=_average([result.memory_mb for result in results]),
        same_faces=all(result.same_faces for result in results),
    )


def _average(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None
