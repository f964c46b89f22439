"""Methods on pairs of a noisy and a clean mesh, measured."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

from cascadenorm.api import denoise
from cascadenorm.controls import checked
from cascadenorm.evaluation.metrics import Measures, measure
from cascadenorm.evaluation.pairs import Places, find_pairs
from cascadenorm.interop import as_mesh
from cascadenorm.mesh import Mesh
from cascadenorm.registry import find

DEFAULT_METHODS = ("auto", "cascade", "bilateral-normal", "guided-normal", "l0")
FAILURES = (ValueError, ArithmeticError, RuntimeError, MemoryError)
"""What a method may end in without ending the evaluation."""
NOISY = "noisy"
"""Name under which the input itself is measured."""


@dataclass(frozen=True, kw_only=True)
class Result:
    """A method on a pair; seconds are those of the method alone, compiled before; 0 for the noisy mesh itself."""

    pair: str
    method: str
    measures: Measures
    seconds: float

    def row(self) -> dict[str, Any]:
        """Everything in one level, by the names in COLUMNS."""
        everything = {**vars(self), **vars(self.measures)}
        return {name: everything[name] for name in COLUMNS}


COLUMNS = ("pair", "method", *(field.name for field in fields(Measures)), "seconds")
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
    parameters: Mapping[str, Any] | None = None,
    strength: float = 1.0,
    threads: int | None = None,
    progress: Callable[[str, int, int], object] | None = None,
) -> Evaluation:
    """Denoise the noisy mesh of each pair by each method and measure it against the clean one.

    Parameters
    ----------
    folders : one or several, each a pair, `noisy.*` and `clean.*`, or a folder of pairs
    methods : one name or several; the noisy mesh itself always comes first
    parameters : given to each of the methods
    strength, threads : as in `denoise`
    progress : called with (what comes next, parts done, parts in all)

    Returns
    -------
    Results in the order of pairs, then methods; what fails is listed, and the rest goes on

    Raises
    ------
    ParameterError : a method or a parameter that does not exist, or a value out of range
    ReadError : there are no pairs
    """
    checked({"strength": strength, "threads": threads})  # raises for values out of range
    settings = {"strength": strength, "threads": threads, **(parameters or {})}
    methods = [methods] if isinstance(methods, str) else methods
    for name in methods:
        find(name).checked(parameters or {})
    pairs = find_pairs(folders)
    done = Evaluation([], [])
    names = tuple(dict.fromkeys((NOISY, *methods)))
    warm = False
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
            if progress is not None:
                progress(f"{pair.name}: {name}", number * len(names) + place, len(pairs) * len(names))
            try:
                done.results.append(_result(pair.name, name, noisy, clean, settings))
            except FAILURES as error:
                done.failures.append(Failure(pair.name, name, error))
    return done


def _warm_up(mesh: Mesh, methods: Sequence[str], settings: Mapping[str, Any]) -> None:
    """Denoise a small piece, so that the times do not depend on what was compiled before."""
    piece = Mesh(mesh.vertices, mesh.faces[:200])
    for name in methods:
        with suppress(*FAILURES):  # told where it happens to the whole
            denoise(piece, method=name, **settings)


def _result(pair: str, method: str, noisy: Mesh, clean: Mesh, settings: Mapping[str, Any]) -> Result:
    if method == NOISY:
        return Result(pair=pair, method=method, measures=measure(noisy, clean), seconds=0.0)
    fresh = Mesh(noisy.vertices, noisy.faces)  # topology is part of the work, for each method
    start = time.perf_counter()
    denoised = denoise(fresh, method=method, **settings)
    seconds = time.perf_counter() - start
    return Result(pair=pair, method=method, measures=measure(denoised, clean), seconds=seconds)


def _mean(method: str, results: Sequence[Result]) -> Result:
    means = {}
    for field in fields(Measures):
        values = [value for result in results if (value := getattr(result.measures, field.name)) is not None]
        means[field.name] = sum(values) / len(values) if values else None
    seconds = sum(result.seconds for result in results) / len(results)
    return Result(pair="mean", method=method, measures=Measures(**means), seconds=seconds)  # type: ignore[arg-type]
