"""Write tables of an evaluation as CSV, Markdown and LaTeX."""

import csv
import io
from collections.abc import Callable, Sequence, Set
from statistics import mean, stdev
from typing import NamedTuple

from cascadenorm.evaluation.harness import MEAN, Evaluation
from cascadenorm.evaluation.runs import COLUMNS, NOISY, RunResult


class Column(NamedTuple):
    """A quantity to show for each result."""

    title: str
    unit: str
    digits: int  # after the decimal point
    value: Callable[[RunResult], float | None]  # function from a result to its value, or to None if it has none
    deviation: Callable[[float], float] = abs  # from a value to its distance from the ideal value
    missing: str = "–"  # text for results without a value


TABLE_COLUMNS = (
    Column("E_a", "°", 2, lambda one: one.measures.normal_error_deg),
    Column("E_a by area", "°", 2, lambda one: one.measures.normal_error_area_deg),
    Column("E_v", "edges", 3, lambda one: one.measures.vertex_error_edges),
    Column("RMS distance", "edges", 3, lambda one: one.measures.vertex_rms_edges),
    Column("Hausdorff", "diagonals", 4, lambda one: one.measures.hausdorff_diagonal),
    Column("flipped", "%", 3, lambda one: one.measures.flipped_percent),
    Column("volume ratio", "", 4, lambda one: one.measures.volume_ratio, lambda value: abs(value - 1), "open"),
    Column("time", "s", 2, lambda one: one.seconds or None),
    Column("memory", "MB", 0, lambda one: one.memory_mb),
)


TERMINAL_COLUMNS = tuple(column for column in TABLE_COLUMNS if column.title not in ("E_a by area", "RMS distance"))
"""Columns that fit into a terminal."""


SPREAD_COLUMNS = ("E_a", "E_a by area", "E_v", "Hausdorff")
"""Titles of the columns for which the spread over seeds is shown."""


PARTIAL_NOTE = " (*: mean over the pairs that there is a result for, not compared)"
"""Addition to a title if methods lack results for some pairs."""


class Cell(NamedTuple):
    """Text of a cell, and whether it is the best value."""

    text: str
    best: bool = False


class Table(NamedTuple):
    """A table whose first row and first column are headings."""

    title: str
    head: tuple[str, ...]
    rows: list[tuple[Cell, ...]]


def pair_table(done: Evaluation) -> Table:
    """Return a table of normal errors and their mean, with one row per pair and one column per method."""
    column = TABLE_COLUMNS[0]
    known = {(one.pair, one.method): one for one in [*done.results, *done.means]}
    names = [pair.name for pair in done.pairs] or list(dict.fromkeys(one.pair for one in done.results))
    rows = []
    for pair in (*names, MEAN):
        of_pair = [known.get((pair, method)) for method in done.methods]
        incomplete = done.partial if pair == MEAN else set()
        cells = zip(done.methods, _cells(column, of_pair, incomplete), strict=True)
        rows.append((Cell(pair), *(_marked(cell, incomplete=method in incomplete) for method, cell in cells)))
    return Table(f"{column.title}, {column.unit}{PARTIAL_NOTE if done.partial else ''}", ("pair", *done.methods), rows)


def method_table(
    results: Sequence[RunResult],
    title: str,
    columns: Sequence[Column] = TABLE_COLUMNS,
    *,
    incomplete: Set[str] = frozenset(),
) -> Table:
    """Return a table with one row per method; `incomplete` methods are marked and not considered for the best value."""
    head = tuple(f"{column.title} ({column.unit})" if column.unit else column.title for column in columns)
    cells = [_cells(column, results, incomplete) for column in columns]
    names = (_marked(Cell(one.method), incomplete=one.method in incomplete) for one in results)
    rows = [(name, *row) for name, *row in zip(names, *cells, strict=True)]
    return Table(f"{title}{PARTIAL_NOTE if incomplete else ''}", ("method", *head), rows)


def means_table(done: Evaluation, title: str, columns: Sequence[Column] = TABLE_COLUMNS) -> Table:
    """Return the means over the pairs, with one row per method; methods that lack a pair are not compared."""
    return method_table(done.means, title, columns, incomplete=done.partial)


def all_tables(done: Evaluation) -> list[Table]:
    """Return the tables of an evaluation: normal errors per pair, means, and the spread over several seeds."""
    several = len(set(done.seeds.values())) > 1
    return [pair_table(done), means_table(done, "Means over the pairs"), *([spread_table(done)] if several else [])]


def spread_table(done: Evaluation) -> Table:
    """Return mean ± standard deviation over seeds of the mean over the pairs of each seed, with one row per method."""
    shown = [column for column in TABLE_COLUMNS if column.title in SPREAD_COLUMNS]
    rows = []
    for method in done.methods:
        cells = [_marked(Cell(method), incomplete=method in done.partial)]
        for column in shown:
            of_seed: dict[int, list[float]] = {}
            for one in done.results:
                value = column.value(one) if one.method == method else None
                if value is not None:
                    of_seed.setdefault(done.seeds[one.pair], []).append(value)
            means = [mean(values) for values in of_seed.values()]
            known = len(means) > 1
            digits = column.digits + 1
            cells.append(Cell(f"{mean(means):.{digits}f} ± {stdev(means):.{digits}f}" if known else column.missing))
        rows.append(tuple(cells))
    head = tuple(f"{column.title} ({column.unit})" for column in shown)
    title = f"Mean ± standard deviation over {len(set(done.seeds.values()))} seeds"
    return Table(f"{title}{PARTIAL_NOTE if done.partial else ''}", ("method", *head), rows)


def _cells(column: Column, results: Sequence[RunResult | None], incomplete: Set[str] = frozenset()) -> list[Cell]:
    """Format the values and mark the best as displayed, unless fewer than two methods are comparable."""
    values = [None if one is None else column.value(one) for one in results]
    texts = [
        "–" if one is None else column.missing if value is None else f"{value:.{column.digits}f}"
        for one, value in zip(results, values, strict=True)
    ]
    judged = {
        number: round(column.deviation(value), column.digits)
        for number, (one, value) in enumerate(zip(results, values, strict=True))
        if one is not None and one.method not in {NOISY, *incomplete} and value is not None
    }
    least = min(judged.values()) if len(judged) > 1 else None
    return [Cell(text, number in judged and judged[number] == least) for number, text in enumerate(texts)]


def _marked(cell: Cell, *, incomplete: bool) -> Cell:
    return cell._replace(text=f"{cell.text} *") if incomplete else cell


def csv_text(done: Evaluation) -> str:
    """Return CSV with a header, and one line per pair and method."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(result.row() for result in done.results)
    return text.getvalue()


def markdown(tables: Sequence[Table]) -> str:
    parts = []
    for table in tables:
        lines = [f"{table.title}:", "", _piped(table.head), _piped(["---", *["---:"] * (len(table.head) - 1)])]
        lines += [_piped([f"**{cell.text}**" if cell.best else cell.text for cell in row]) for row in table.rows]
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def _piped(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def latex(tables: Sequence[Table]) -> str:
    """Return tables in LaTeX, which need the package booktabs."""
    parts = []
    for table in tables:
        lines = [f"% {table.title}", rf"\begin{{tabular}}{{l{'r' * (len(table.head) - 1)}}}", r"\toprule"]
        lines += [" & ".join(map(_escaped, table.head)) + r" \\", r"\midrule"]
        for number, row in enumerate(table.rows):
            if row[0].text == MEAN and number:
                lines.append(r"\midrule")
            cells = [rf"\textbf{{{_escaped(cell.text)}}}" if cell.best else _escaped(cell.text) for cell in row]
            lines.append(" & ".join(cells) + r" \\")
        parts.append("\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""]))
    return "\n".join(parts)


LATEX = {
    "±": r"$\pm$",
    "\\": r"\textbackslash{}",
    "°": r"$^\circ$",
    "–": "--",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
}
LATEX_SYMBOLS = {"E_a": "$E_a$", "E_v": "$E_v$"}


def _escaped(text: str) -> str:
    """Escape text for LaTeX; symbols of measures become formulas."""
    for name, formula in LATEX_SYMBOLS.items():
        if text.startswith(name):
            return formula + _escaped(text[len(name) :])
    return "".join(f"\\{letter}" if letter in "&%$#_{}" else LATEX.get(letter, letter) for letter in text)
