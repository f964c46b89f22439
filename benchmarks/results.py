"""Measure methods on noisy/clean pairs and write the table into the README.

python benchmarks/results.py DIR [--readme FILE] [--method NAME ...]
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from cascadenorm.evaluation.harness import DEFAULT_METHODS, NOISY, Evaluation, evaluate

BEGIN, END = "<!-- results: written by benchmarks/results.py -->", "<!-- end of results -->"


def main(arguments: Sequence[str] | None = None) -> None:
    """Evaluate a folder of pairs and replace what stands between the markers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR", help="pairs: */noisy.* and */clean.*")
    parser.add_argument("--readme", type=Path, default=Path(__file__).parents[1] / "README.md")
    parser.add_argument("--method", action="append", help="may be given several times")
    chosen = parser.parse_args(arguments)
    methods = tuple(chosen.method or DEFAULT_METHODS)
    progress = Console(stderr=True)
    done = evaluate(
        [chosen.folder], methods=methods, progress=lambda text, part, parts: progress.print(f"{part}/{parts} {text}")
    )
    if done.failures:
        raise SystemExit("\n".join(f"{failure.pair}, {failure.method}: {failure.error}" for failure in done.failures))
    text = chosen.readme.read_text(encoding="utf-8")
    chosen.readme.write_text(between_markers(text, results_table(done, methods)), encoding="utf-8")


def between_markers(text: str, table: str, begin: str = BEGIN, end: str = END) -> str:
    """Replace what stands between two markers."""
    if text.count(begin) != 1 or text.count(end) != 1:
        raise SystemExit(f"the text must hold '{begin}' and '{end}' once each")
    head, rest = text.split(begin)
    return f"{head}{begin}\n{table}\n{end}{rest.split(end)[1]}"


def results_table(done: Evaluation, methods: Sequence[str]) -> str:
    """Mean angle between face normals for each pair, the best in bold; means of all measures at the end."""
    columns = (NOISY, *methods)
    found = {(result.pair, result.method): result for result in done.results}
    means = {result.method: result for result in done.means}
    pairs = list(dict.fromkeys(result.pair for result in done.results))
    angles = [[found[pair, method].measures.normal_error_deg for method in columns] for pair in pairs]
    mean_angles = [means[method].measures.normal_error_deg for method in columns]
    vertices = [means[method].measures.vertex_error_edges for method in columns]
    turned = [means[method].measures.turned_percent for method in columns]
    seconds = [means[method].seconds for method in columns]
    rows = [
        ("pair", *columns),
        ("---", *["---:"] * len(columns)),
        *((pair, *_best_in_bold(values, 2)) for pair, values in zip(pairs, angles, strict=True)),
        ("**mean angle of normals, degrees**", *_best_in_bold(mean_angles, 2)),
        ("mean distance of vertices, edge lengths", *_best_in_bold(vertices, 3)),
        ("flipped faces, %", *_best_in_bold(turned, 3)),
        (f"mean time, {methods[0]} = 1", "", *(f"{value / seconds[1]:.2f}" for value in seconds[1:])),
    ]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _best_in_bold(values: Sequence[float], digits: int) -> list[str]:
    texts = [f"{value:.{digits}f}" for value in values]
    least = min(texts, key=float)
    return [f"**{text}**" if text == least else text for text in texts]


if __name__ == "__main__":
    main()
