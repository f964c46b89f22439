"""Measure methods on pairs of noisy and clean meshes.

    python -m benchmarks.accuracy.pairs PAIRS [--method NAME ...] [--reference FILE] [--keep FOLDER] [--record NAME]
    python -m benchmarks.accuracy.pairs PAIRS --collect GuidedDenoising MeshTGV

`--collect` first copies the nine public pairs of README.md into PAIRS, from clones of the repositories (docs/data.md).
README.md shows the record `public-pairs`, benchmarks/accuracy.md `validation`. FILE has the errors of other programs
as JSON: pair → run → {"Ea_deg": degrees, "Ev": edge lengths, "flip": %}. Runs whose names end in "tuned" had their
parameters chosen against the clean mesh; "published" is the denoised mesh that was published for the pair.
"""

import argparse
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks import results
from cascadenorm.cli.progress_bars import progress_tasks
from cascadenorm.evaluation.harness import DEFAULT_METHODS, NOISY, Evaluation, evaluate
from cascadenorm.evaluation.public_sets import public_pairs

STEERED = "kinect_cone"
"""The pair that influenced the choice of training shapes. It is left out of the means."""
TUNED, PUBLISHED = "best classical, oracle-tuned", "published"
TUNED_NOTE = (
    f"*{TUNED.capitalize()}*: the lowest error of the bilateral, guided, L0, Fleishman's and Jones' filters in the "
    "program of Zhang et al. (2015), each tuned against the clean mesh of the pair."
)
PUBLISHED_NOTE = f"*{PUBLISHED.capitalize()}*: the denoised mesh that was published for the pair, if there is one."

Errors = tuple[float, float, float]
"""Mean angle in degrees, mean distance of the vertices in edge lengths, flipped faces in per cent."""
Reference = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""Pair → run → errors."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Evaluate a folder of pairs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="PAIRS", help="folder of */noisy.* and */clean.*")
    parser.add_argument("--method", action="append", help="may be given several times")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="for results, so that an interrupted run resumes")
    parser.add_argument("--reference", type=Path, metavar="FILE", help="errors of other programs")
    parser.add_argument("--collect", type=Path, nargs=2, metavar="CLONE", help="clones of GuidedDenoising and MeshTGV")
    results.add_option(parser)
    options = parser.parse_args(arguments)
    if options.collect:
        collect(*options.collect, options.folder)
    reference = json.loads(options.reference.read_text(encoding="utf-8")) if options.reference else {}
    with progress_tasks() as progress:
        methods = tuple(options.method or DEFAULT_METHODS)
        done = evaluate([options.folder], methods=methods, keep=options.keep, progress=progress)
    if done.failures:
        raise SystemExit("\n".join(f"{failure.pair}, {failure.method}: {failure.error}" for failure in done.failures))
    results.report(options.record, figures_of(done, reference), table)


def collect(guided: Path, tgv: Path, out: Path) -> None:
    """Copy noisy.obj and clean.obj of each public pair to a folder with its name, and check their digests."""
    of_tgv = [pair for pair in public_pairs("mesh-tgv", tgv) if pair.name == STEERED]
    for pair in [*public_pairs("guided", guided), *of_tgv]:
        folder = out / pair.name
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(pair.noisy, folder / "noisy.obj")
        shutil.copyfile(pair.clean, folder / "clean.obj")


def figures_of(done: Evaluation, reference: Reference) -> dict[str, Any]:
    """Return errors of each column on each pair, their means, and the mean times relative to the first method."""
    pairs: dict[str, dict[str, Errors]] = {}
    for result in done.results:
        found = result.measures
        errors = found.normal_error_deg, found.vertex_error_edges, found.flipped_percent
        pairs.setdefault(result.pair, {})[result.method] = errors
    for pair, columns in pairs.items():
        columns |= other_programs(reference.get(pair, {}))
    names = [*done.methods, *([TUNED, PUBLISHED] if reference else [])]
    judged = [columns for pair, columns in pairs.items() if pair != STEERED] or list(pairs.values())
    means = {
        name: [sum(values) / len(judged) for values in zip(*(columns[name] for columns in judged), strict=True)]
        for name in names
        if all(name in columns for columns in judged)
    }
    seconds = {result.method: result.seconds for result in done.means if result.method != NOISY}
    first = next(iter(seconds.values()))
    times = {name: value / first for name, value in seconds.items() if value is not None and first}
    return {"columns": names, "pairs": pairs, "means": means, "times": times}


def other_programs(runs: Mapping[str, Mapping[str, Any]]) -> dict[str, Errors]:
    """Return the errors of the best tuned run of a pair, and of its published mesh."""
    tuned = [run for name, run in runs.items() if name.endswith(" tuned")]
    chosen = {PUBLISHED: runs[PUBLISHED]} if PUBLISHED in runs else {}
    if tuned:
        chosen[TUNED] = min(tuned, key=lambda run: float(run["Ea_deg"]))
    return {name: (run["Ea_deg"], run["Ev"], run["flip"]) for name, run in chosen.items()}


def table(figures: results.Figures) -> str:
    """Return the mean angles of each pair, the lowest in bold, below them the means of all measures, and notes."""
    columns, pairs, means, times = (figures[key] for key in ("columns", "pairs", "means", "times"))
    without = f" without {STEERED}" if STEERED in pairs and len(pairs) > 1 else ""

    def row(title: str, values: Mapping[str, Sequence[float]], measure: int, digits: int) -> list[str]:
        shown = [f"{values[name][measure]:.{digits}f}" if name in values else "–" for name in columns]
        return [title, *_lowest_in_bold(shown)]

    rows = [
        *(row(pair, values, 0, 2) for pair, values in pairs.items()),
        row(f"**mean angle of normals{without}, degrees**", means, 0, 2),
        row(f"mean distance of vertices{without}, edge lengths", means, 1, 3),
        row(f"flipped faces{without}, %", means, 2, 3),
        [
            f"mean time, {next(iter(times))} = 1",
            *(f"{times[name]:.2f}" if name in times else "" for name in columns),
        ],
    ]
    notes = [f"Fused scans were added to the training shapes because of {STEERED}, so the means leave it out."]
    notes = (notes if without else []) + ([TUNED_NOTE, PUBLISHED_NOTE] if TUNED in columns else [])
    return "\n\n".join([results.markdown(["pair", *columns], rows), *([" ".join(notes)] if notes else [])])


def _lowest_in_bold(cells: Sequence[str]) -> list[str]:
    lowest = min((cell for cell in cells if cell != "–"), key=float)
    return [f"**{cell}**" if cell == lowest else cell for cell in cells]


if __name__ == "__main__":
    main()
