"""Measure methods on noisy/clean pairs and write the table into the README.

python -m benchmarks.accuracy.results DIR [--readme FILE] [--method NAME ...] [--reference FILE]

FILE holds what other programs get, as JSON: pair → run → {"Ea_deg": degrees, "Ev": edge lengths, "flip": %}. Runs that
end in "tuned" have parameters chosen by the true mesh; "published" is a mesh that was published for that pair.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cascadenorm.cli.progress_bars import progress_tasks
from cascadenorm.evaluation.harness import DEFAULT_METHODS, NOISY, Evaluation, evaluate

BEGIN, END = "<!-- results: written by benchmarks/accuracy/results.py -->", "<!-- end of results -->"
STEERED = "kinect_cone"
"""The pair by which a choice of training shapes was made; it does not count in the means."""
TUNED, PUBLISHED = "best classical, tuned by the truth", "published"
REFERENCE_NOTE = (
    f"*{TUNED.capitalize()}*: the least error of the bilateral, guided, L0, Fleishman's and Jones' filters in the "
    "program of Zhang et al. (2015), each tuned on the clean mesh of the pair, which no user has. "
    f"*{PUBLISHED.capitalize()}*: the denoised mesh that was published for the pair, where there is one."
)

Reference = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""Pair → run → figures."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Evaluate a folder of pairs and replace what stands between the markers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR", help="pairs: */noisy.* and */clean.*")
    parser.add_argument("--readme", type=Path, default=Path(__file__).parents[2] / "README.md")
    parser.add_argument("--method", action="append", help="may be given several times")
    parser.add_argument("--reference", type=Path, metavar="FILE", help="figures of other programs")
    chosen = parser.parse_args(arguments)
    reference = json.loads(chosen.reference.read_text(encoding="utf-8")) if chosen.reference else None
    methods = tuple(chosen.method or DEFAULT_METHODS)
    with progress_tasks() as progress:
        done = evaluate([chosen.folder], methods=methods, progress=progress)
    if done.failures:
        raise SystemExit("\n".join(f"{failure.pair}, {failure.method}: {failure.error}" for failure in done.failures))
    text = chosen.readme.read_text(encoding="utf-8")
    chosen.readme.write_text(between_markers(text, results_table(done, methods, reference)), encoding="utf-8")


def between_markers(text: str, table: str, begin: str = BEGIN, end: str = END) -> str:
    """Replace what stands between two markers."""
    if text.count(begin) != 1 or text.count(end) != 1:
        raise SystemExit(f"the text must hold '{begin}' and '{end}' once each")
    head, rest = text.split(begin)
    return f"{head}{begin}\n{table}\n{end}{rest.split(end)[1]}"


def results_table(done: Evaluation, methods: Sequence[str], reference: Reference | None = None) -> str:
    """Mean angle between face normals for each pair, the best in bold; means of all measures at the end."""
    columns = (NOISY, *methods)
    found = {
        (result.pair, result.method): (
            result.measures.normal_error_deg,
            result.measures.vertex_error_edges,
            result.measures.flipped_percent,
        )
        for result in done.results
    }
    pairs = list(dict.fromkeys(result.pair for result in done.results))
    if reference is not None:
        for pair in pairs:
            found |= {(pair, name): values for name, values in other_results(reference.get(pair, {})).items()}
        columns += (TUNED, PUBLISHED)
    judged = [pair for pair in pairs if pair != STEERED] or pairs
    without = "" if judged == pairs else f" without {STEERED}"
    seconds = {result.method: result.seconds for result in done.means}
    times = [f"{seconds[name] / seconds[methods[0]]:.2f}" if seconds.get(name) else "" for name in columns]

    def row(title: str, pairs: Sequence[str], measure: int, digits: int) -> tuple[str, ...]:
        """Means over pairs, of columns that have them all."""
        values = [[found[pair, name][measure] for pair in pairs if (pair, name) in found] for name in columns]
        means = [sum(some) / len(some) if len(some) == len(pairs) else None for some in values]
        return title, *_best_in_bold(means, digits)

    rows = [
        ("pair", *columns),
        ("---", *["---:"] * len(columns)),
        *(row(pair, [pair], 0, 2) for pair in pairs),
        row(f"**mean angle of normals{without}, degrees**", judged, 0, 2),
        row(f"mean distance of vertices{without}, edge lengths", judged, 1, 3),
        row(f"flipped faces{without}, %", judged, 2, 3),
        (f"mean time, {methods[0]} = 1", *times),
    ]
    notes = (
        [f"{STEERED} led to the fused scans among the training shapes, so the means are taken without it."]
        if without
        else []
    ) + ([REFERENCE_NOTE] if reference is not None else [])
    table = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    return "\n\n".join([table, " ".join(notes)]) if notes else table


def other_results(runs: Mapping[str, Mapping[str, Any]]) -> dict[str, tuple[float, float, float]]:
    """Angle, vertex error and flipped faces of the best tuned run of a pair, and of its published mesh."""
    tuned = [run for name, run in runs.items() if name.endswith(" tuned")]
    chosen = {PUBLISHED: runs[PUBLISHED]} if PUBLISHED in runs else {}
    if tuned:
        chosen[TUNED] = min(tuned, key=lambda run: float(run["Ea_deg"]))
    return {name: (run["Ea_deg"], run["Ev"], run["flip"]) for name, run in chosen.items()}


def _best_in_bold(values: Sequence[float | None], digits: int) -> list[str]:
    texts = ["–" if value is None else f"{value:.{digits}f}" for value in values]
    least = min((text for text in texts if text != "–"), key=float)
    return [f"**{text}**" if text == least else text for text in texts]


if __name__ == "__main__":
    main()
