"""Methods on pairs of a noisy and a clean mesh, measured."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from itertools import chain
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from cascadenorm.controls import checked
from cascadenorm.errors import ParameterError, ReadError
from cascadenorm.evaluation.pairs import with_noise
from cascadenorm.evaluation.programs import TIMEOUT_S, checked_command
from cascadenorm.evaluation.records import Records
from cascadenorm.evaluation.runs import COLUMNS, NOISY, FailedRun, Run, RunResult, forget, run
from cascadenorm.execution.cluster import LOCAL_CLUSTER, folder_of_names
from cascadenorm.execution.cluster_map import side_by_side_on
from cascadenorm.execution.process_map import side_by_side
from cascadenorm.execution.progress import Progress, silent
from cascadenorm.geometry.metrics import Measures
from cascadenorm.io.pairs import FilePair, Paths, find_pairs
from cascadenorm.registry import find

__all__ = ["COLUMNS", "DEFAULT_METHODS", "NOISY", "Evaluation", "FailedRun", "RunResult", "evaluate"]

DEFAULT_METHODS = ("auto", "cascade", "bilateral-normal", "guided-normal", "l0")


class Evaluation(NamedTuple):
    """What was measured, pair by pair, and what failed.

    Parameters
    ----------
    pairs
        The files of each pair.
    records
        Where the meshes are kept, if anywhere.
    """

    results: list[RunResult]
    failures: list[FailedRun]
    pairs: Sequence[FilePair] = ()
    records: Records | None = None

    @property
    def methods(self) -> list[str]:
        """Names of the rows in their order, the noisy mesh first."""
        return list(dict.fromkeys(result.method for result in self.results))

    @property
    def seeds(self) -> dict[str, int]:
        """The seed of the noise of each pair that has one, by its name."""
        return {pair.name: pair.seed for pair in self.pairs if pair.seed is not None}

    @property
    def partial(self) -> set[str]:
        """Names of the rows that lack a pair, so that their means are over fewer pairs than those of others."""
        counts = Counter(result.method for result in self.results)
        return {name for name in counts if counts[name] < max(counts.values())}

    @property
    def means(self) -> list[RunResult]:
        """The mean of each method over the pairs that have a value."""
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
    progress: Progress = silent,
) -> Evaluation:
    """Denoise the noisy mesh of each pair by each method and measure it against the clean one.

    Parameters
    ----------
    folders
        One or several, each a pair, `noisy.*` and `clean.*`, or a folder of pairs; or pairs, as `public_pairs` returns
        them.
    methods
        One name or several; the noisy mesh itself always comes first.
    results
        Of other programs: the name of each and its folder, which holds a mesh `<pair>.*` for each pair.
    commands
        Other programs to be run: the name of each and its command line, where {in} and {out} stand for the files, and
        {in.obj} and {out.obj} for files of that format; no shell reads it.
    timeout
        Seconds after which such a program is stopped.
    parameters
        Given to each of the methods.
    strength, threads
        As in `denoise`.
    noise
        Standard deviation, in mean edge lengths, of Gaussian noise along the normals that is added to the clean meshes,
        in the place of the noisy ones; None takes these.
    seeds
        Noisy meshes of each clean one; the tables then have the spread over seeds.
    keep
        Folder for the meshes and their measures; what is there from an earlier run of the same files, settings, weights
        and version is not computed again.
    workers
        Processes, each of one thread if there are several; times then depend on what else runs.
    scheduler
        Address of the scheduler of a Dask cluster, whose workers see the same files; "local" makes a cluster of so many
        processes on this machine; None starts processes without Dask.
    progress
        Called with (task, parts done, parts in all, what comes next).

    Returns
    -------
    Results in the order of pairs, then methods, results, commands; what fails or is missing is listed, and the rest
    goes on

    Raises
    ------
    ParameterError
        A method, a program or a parameter that does not exist, a value out of range, another program that is called
        like a method; no scheduler at the address.
    WorkerError
        Processes, or workers of a cluster, have ended before the work was done.
    ReadError
        There are no pairs, or no folder of results; results, and several pairs of one name.
    """
    checked({"strength": strength, "threads": threads})  # raises for values out of range
    settings = {"strength": strength, "threads": threads, **(parameters or {})}
    methods = [methods] if isinstance(methods, str) else methods
    for name in methods:
        find(name).checked(parameters or {})
    programs = {name: checked_command(name, command) for name, command in (commands or {}).items()}
    _check_numbers(workers, noise, seeds)
    if not timeout > 0:
        raise ParameterError(f"is {timeout}; it must be above 0", parameter="timeout")
    if noise is not None and keep is None and scheduler not in (None, LOCAL_CLUSTER):
        raise ParameterError("must be a folder that all workers see: the noisy meshes go there", parameter="keep")
    pairs = _pairs(folders)
    places = {name: Path(place) for name, place in (results or {}).items()}
    _check_names([*places, *programs], methods)
    _check_results(places, pairs)
    records = Records(Path(keep)) if keep is not None else None
    rows = _rows(methods, settings, places, programs, timeout)
    with TemporaryDirectory() as scratch:
        unread: list[tuple[FilePair, Exception]] = []
        if noise is not None:
            pairs, unread = with_noise(pairs, Path(keep or scratch) / "noise", level=noise, seeds=seeds)
        runs = [Run(pair, name, records=records, **row) for pair in pairs for name, row in rows.items()]
        done = Evaluation([], [FailedRun(pair.name, None, error) for pair, error in unread], pairs, records)
        folder = folder_of_names(_names(pairs, places, keep), [*settings.values(), *chain(*programs.values())])
        with side_by_side_on(scheduler, workers=workers, folder=folder):
            _work_off(runs, done, workers, progress)
    return done


def _names(
    pairs: Sequence[FilePair], places: Mapping[str, Path], keep: str | PathLike[str] | None
) -> list[str | PathLike[str]]:
    """Return the files and folders of an evaluation."""
    files = [file for pair in pairs for file in (pair.noisy, pair.clean)]
    return [*files, *places.values(), *([] if keep is None else [keep])]


def _pairs(folders: Paths | Iterable[FilePair | str | PathLike[str]]) -> list[FilePair]:
    if isinstance(folders, str | PathLike):
        return find_pairs(folders)
    given = list(folders)
    pairs = [one for one in given if isinstance(one, FilePair)]
    return pairs + (
        find_pairs([one for one in given if not isinstance(one, FilePair)]) if len(pairs) < len(given) else []
    )


def _rows(
    methods: Sequence[str],
    settings: dict[str, Any],
    places: Mapping[str, Path],
    programs: Mapping[str, Any],
    timeout: float,
) -> dict[str, dict[str, Any]]:
    """Return what to run for each row, by its name, the noisy mesh first."""
    return {
        NOISY: {},
        **{name: {"settings": settings} for name in methods},
        **{name: {"results": place} for name, place in places.items()},
        **{name: {"command": words, "timeout": timeout} for name, words in programs.items()},
    }


def _work_off(runs: Sequence[Run], done: Evaluation, workers: int, progress: Progress) -> None:
    """Do the runs and list what comes out; a pair that cannot be read is listed once."""
    unread: set[str] = set()
    try:
        with side_by_side(workers) as each:
            found = each(run, runs)
            for number, task in enumerate(runs):
                progress("evaluating", number, len(runs), f"{task.pair.name}: {task.name}")
                out = next(found)
                if isinstance(out, RunResult):
                    done.results.append(out)
                elif out.method is not None or out.pair not in unread:
                    unread |= {out.pair} if out.method is None else set()
                    done.failures.append(out)
    finally:
        forget()
    progress("evaluating", len(runs), len(runs))


def _check_numbers(workers: int, noise: float | None, seeds: int) -> None:
    if workers < 1:
        raise ParameterError(f"is {workers}; it must be at least 1", parameter="workers")
    if seeds < 1 or (noise is None and seeds > 1):
        raise ParameterError(f"is {seeds}; it must be at least 1, and exactly 1 without noise", parameter="seeds")
    if noise is not None and not 0 <= noise < math.inf:
        raise ParameterError(f"is {noise}; it must be at least 0, finite", parameter="noise")


def _check_names(names: Sequence[str], methods: Sequence[str]) -> None:
    """Refuse names that stand for two rows, or for no file."""
    for number, name in enumerate(names):
        if name in (NOISY, *methods):
            raise ParameterError(f"the results {name!r} have the name of a method: choose another name")
        if name in names[:number]:
            raise ParameterError(f"two rows are named {name!r}: rename one")
        if Path(name).name != name:
            raise ParameterError(f"the results are named {name!r}, which is not a file name: choose another name")


def _check_results(places: Mapping[str, Path], pairs: Sequence[FilePair]) -> None:
    """Refuse results that have no folder, or pairs that cannot be told apart by name."""
    for place in places.values():
        if not place.is_dir():
            raise ReadError(f"{place} is not a folder: give one that holds a mesh <pair>.* for each pair")
        twice = [pair.name for pair in pairs if Path(pair.name).name != pair.name]
        if twice:
            raise ReadError(
                f"several pairs are named {Path(twice[0]).name}: rename one, since results are stored by name"
            )


def _mean(method: str, results: Sequence[RunResult]) -> RunResult:
    means = {field.name: _average([getattr(result.measures, field.name) for result in results]) for field in MEASURES}
    return RunResult(
        pair="mean",
        method=method,
        measures=Measures(**means),  # type: ignore[arg-type]
        seconds=sum(result.seconds for result in results) / len(results),
        memory_mb=_average([result.memory_mb for result in results]),
        same_faces=all(result.same_faces for result in results),
    )


MEASURES = fields(Measures)


def _average(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return sum(known) / len(known) if known else None
