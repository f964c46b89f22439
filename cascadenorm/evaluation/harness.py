"""Methods on pairs of a noisy and a clean mesh, measured."""

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cascadenorm.api import denoise
from cascadenorm.controls import checked
from cascadenorm.errors import ParameterError, ReadError
from cascadenorm.evaluation.metrics import Measures, measure
from cascadenorm.evaluation.pairs import Pair, Places, find_pairs, result_file
from cascadenorm.interop import as_mesh
from cascadenorm.mesh import Mesh
from cascadenorm.progress import Progress, silent
from cascadenorm.registry import find

DEFAULT_METHODS = ("auto", "cascade", "bilateral-normal", "guided-normal", "l0")
FAILURES = (ValueError, ArithmeticError, RuntimeError, MemoryError)
"""What a method may end in without ending the evaluation."""
NOISY = "noisy"
"""Name under which the input itself is measured."""


@dataclass(frozen=True, kw_only=True)
class Result:
    """A method, or another program, on a pair.

    Parameters
    ----------
    seconds : of the method alone, compiled before; 0 for the noisy mesh itself and for results of other programs
    same_faces : whether the faces are those of the clean mesh; else each is compared with the nearest of them
    """

    pair: str
    method: str
    measures: Measures
    seconds: float
    same_faces: bool

    def row(self) -> dict[str, Any]:
        """Everything in one level, by the names in COLUMNS."""
        everything = {**vars(self), **vars(self.measures)}
        return {name: everything[name] for name in COLUMNS}


COLUMNS = ("pair", "method", *(field.name for field in fields(Measures)), "seconds", "same_faces")
"""Names in a row of a result."""


class Failure(NamedTuple):
    """A pair, or a method on it, that could not be measured."""

    pair: str
    method: str | None
    error: Exception


class Evaluation(NamedTuple):
    """What was measured, pair by pair, and what failed."""

    results: list[Result]
    failures: list[Failure]

    @property
    def means(self) -> list[Result]:
        """The mean of each method over the pairs that have a value."""
        names = dict.fromkeys(result.method for result in self.results)
        return [_mean(name, [result for result in self.results if result.method == name]) for name in names]


def evaluate(
    folders: Places,
    *,
    methods: str | Sequence[str] = DEFAULT_METHODS,
    results: Mapping[str, str | PathLike[str]] | None = None,
    parameters: Mapping[str, Any] | None = None,
    strength: float = 1.0,
    threads: int | None = None,
    progress: Progress = silent,
) -> Evaluation:
    """Denoise the noisy mesh of each pair by each method and measure it against the clean one.

    Parameters
    ----------
    folders : one or several, each a pair, `noisy.*` and `clean.*`, or a folder of pairs
    methods : one name or several; the noisy mesh itself always comes first
    results : of other programs: the name of each and its folder, which holds a mesh `<pair>.*` for each pair
    parameters : given to each of the methods
    strength, threads : as in `denoise`
    progress : called with (task, parts done, parts in all, what comes next)

    Returns
    -------
    Results in the order of pairs, then methods, then other programs; what fails or is missing is listed, and the rest
    goes on

    Raises
    ------
    ParameterError : a method or a parameter that does not exist, a value out of range, another program that is called
        like a method
    ReadError : there are no pairs, or no folder of results; results, and several pairs of one name
    """
    checked({"strength": strength, "threads": threads})  # raises for values out of range
    settings = {"strength": strength, "threads": threads, **(parameters or {})}
    methods = [methods] if isinstance(methods, str) else methods
    for name in methods:
        find(name).checked(parameters or {})
    pairs = find_pairs(folders)
    places = {name: Path(place) for name, place in (results or {}).items()}
    _check_results(places, methods, pairs)
    done = Evaluation([], [])
    names = tuple(dict.fromkeys((NOISY, *methods, *places)))
    parts, warm = len(pairs) * len(names), False
    for number, pair in enumerate(pairs):
        try:
            noisy, clean = as_mesh(pair.noisy), as_mesh(pair.clean)
        except ValueError as error:
            done.failures.append(Failure(pair.name, None, error))
            continue
        if not warm:
            _warm_up(noisy, methods, settings)
            warm = True
        for place, name in enumerate(names):
            progress("evaluating", number * len(names) + place, parts, f"{pair.name}: {name}")
            try:
                other = as_mesh(result_file(places[name], pair)) if name in places else None
                done.results.append(_result(pair.name, name, noisy, clean, settings, other))
            except FAILURES as error:
                done.failures.append(Failure(pair.name, name, error))
    progress("evaluating", parts, parts)
    return done


def _warm_up(mesh: Mesh, methods: Sequence[str], settings: Mapping[str, Any]) -> None:
    """Denoise a small piece, so that the times do not depend on what was compiled before."""
    piece = Mesh(mesh.vertices, mesh.faces[:200])
    for name in methods:
        with suppress(*FAILURES):  # told where it happens to the whole
            denoise(piece, method=name, **settings)


def _check_results(places: Mapping[str, Path], methods: Sequence[str], pairs: Sequence[Pair]) -> None:
    """Refuse results that have the name of a method, no folder, or pairs that cannot be told apart by name."""
    for name, place in places.items():
        if name in (NOISY, *methods):
            raise ParameterError(f"results are called {name}, as a method is: give them another name")
        if not place.is_dir():
            raise ReadError(f"{place} is not a folder: give one that holds a mesh <pair>.* for each pair")
        twice = [pair.name for pair in pairs if Path(pair.name).name != pair.name]
        if twice:
            raise ReadError(f"several pairs are called {Path(twice[0]).name}: rename one, since results go by name")


def _result(
    pair: str, method: str, noisy: Mesh, clean: Mesh, settings: Mapping[str, Any], other: Mesh | None
) -> Result:
    """Measure the noisy mesh, that of another program, or what a method makes of it."""
    seconds, denoised = 0.0, noisy if other is None else other
    if method != NOISY and other is None:
        fresh = Mesh(noisy.vertices, noisy.faces)  # topology is part of the work, for each method
        start = time.perf_counter()
        denoised = denoise(fresh, method=method, **settings)
        seconds = time.perf_counter() - start
    same = np.array_equal(denoised.faces, clean.faces)
    return Result(pair=pair, method=method, measures=measure(denoised, clean), seconds=seconds, same_faces=same)


def _mean(method: str, results: Sequence[Result]) -> Result:
    means = {}
    for field in fields(Measures):
        values = [value for result in results if (value := getattr(result.measures, field.name)) is not None]
        means[field.name] = sum(values) / len(values) if values else None
    seconds = sum(result.seconds for result in results) / len(results)
    same = all(result.same_faces for result in results)
    measures = Measures(**means)  # type: ignore[arg-type]
    return Result(pair="mean", method=method, measures=measures, seconds=seconds, same_faces=same)
