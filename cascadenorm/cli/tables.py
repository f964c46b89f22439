"""Print results as text, as tables and as JSON."""

import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Any, TextIO

from cascadenorm.cli.errors import notify
from cascadenorm.cli.options import CONTROL_OPTIONS
from cascadenorm.errors import counted

if TYPE_CHECKING:  # imported for type checking only, because each command would load what others need
    from rich.text import Text

    from cascadenorm.api.filled_files import Filling
    from cascadenorm.api.inspection import Inspection
    from cascadenorm.api.opened_files import DenoisingSummary
    from cascadenorm.api.spectra import Spectrum
    from cascadenorm.batch.batch import Batch
    from cascadenorm.evaluation.harness import Evaluation
    from cascadenorm.geometry.metrics import Measures
    from cascadenorm.learned.training.training_log import Pass
    from cascadenorm.mesh import Mesh
    from cascadenorm.registry import Method, Setting

BARS = "▁▂▃▄▅▆▇█"
CHART_WIDTH = 40
COARSE_RESOLUTION = 0.01  # resolution of the number type, in mean edge lengths, above which it is reported
MOST_NAMED_FILES = 3  # maximum number of skipped files that are listed by name
PLAIN_WIDTH = 120  # width of a table in characters if the output is not a terminal
SCHEMA_VERSION = 1
"""Version of the schema; it changes if a key is renamed, removed or redefined, but not if one is added."""


def print_denoised(done: "DenoisingSummary", *, file: TextIO, can_weld: bool = True) -> None:
    """Print what was done; `can_weld` is whether the command has the option --weld."""
    print(f"{done.source} -> {done.output}", file=file)
    print(
        f"{done.method}: {counted(done.faces, 'face')} in {done.seconds:.2f} s; "
        f"{done.moved} of {counted(done.vertices, 'vertex', 'vertices')} moved, "
        f"by {done.mean_displacement:.3g} mean edge lengths on average, {done.largest_displacement:.3g} at most",
        file=file,
    )
    if done.error is not None:
        print(f"kind of error: {done.error}", file=file)
    if done.treated_as is not None:
        print(f"treated as: {done.treated_as}", file=file)
    controls = {"strength": done.strength, **done.controls}
    chosen = [_option(name, value) for name, value in controls.items() if value != CONTROL_OPTIONS[name].default]
    if chosen:
        print(f"controls: {', '.join(chosen)}", file=file)
    if done.dropped_components:
        components = counted(done.dropped_components, "small component")
        notify(f"dropped: {components} of {counted(done.dropped_faces, 'face')} in all")
    elif done.components is not None:
        limit = str(done.drop_components).strip()
        size = f"{limit} of the faces of the largest" if "%" in limit else f"{limit} faces"
        others = f", and all except the largest have at least {size}" if done.components > 1 else ""
        notify(f"dropped nothing: the mesh has {counted(done.components, 'connected component')}{others}")
    if done.left_unchanged:
        notify(f"left unchanged: {done.left_unchanged}")
    if done.volume_not_kept:
        notify(done.volume_not_kept)
    if done.remedies:
        notify(done.remedies)
    if done.nearly_coincident:
        near = counted(done.nearly_coincident, "boundary vertex lies", "boundary vertices lie")
        advice = ": --weld '0.001 edges' joins them" if can_weld else ""
        notify(f"{near} within 0.001 edges of another one, but not joined with it{advice}")
    print_left_out(done.left_out)


def print_new_faults(faults: Mapping[str, tuple[int, int]]) -> None:
    """Print which faults became more frequent, from their numbers before and after denoising."""
    words = {
        "crossing_faces": ("self-intersecting face", "self-intersecting faces"),
        "spikes": ("spike", "spikes"),
        "folded_edges": ("edge folded by more than 90°", "edges folded by more than 90°"),
    }
    more = [f"{counted(after, *words[name])} ({before} before)" for name, (before, after) in faults.items()]
    if more:
        notify(f"the result has {', '.join(more)}")


def print_batch(done: "Batch", output: str) -> None:
    """Print how many files were denoised, skipped or failed, and where the results are."""
    denoised = len(done.lines) - len(done.failures)
    seconds = sum(line["seconds"] for line in done.lines)
    method = sum(line["summary"]["seconds"] for line in done.lines if line["summary"])
    time = f" in {seconds:.1f} s of process time, {method:.1f} s of it for the method" if denoised else ""
    print(f"{counted(denoised, 'file')} denoised{time}")
    if done.kept:
        print(f"{counted(len(done.kept), 'file')} skipped: already done")
    if done.skipped:
        names = ", ".join([*done.skipped[:MOST_NAMED_FILES], *(["…"] if len(done.skipped) > MOST_NAMED_FILES else [])])
        print(f"{counted(len(done.skipped), 'file')} skipped: results of `denoise` beside their sources ({names})")
    if done.failures:
        print(f"{counted(len(done.failures), 'file')} failed")
    if denoised or done.kept:
        print(f"the results are in {output}")


def print_filling(target: Path, done: "Filling", max_edges: int | None) -> None:
    """Print how many holes of a file were closed, and which boundaries stayed open and why."""
    faces = f" by {counted(done.added, 'face')}, added to {done.faces}" if done.closed else ""
    print(f"{target}: {counted(done.closed, 'hole')} closed{faces}")
    for edges in done.outer:
        print(f"kept open: the outer boundary of an open component, {edges} edges (--outer fill closes it)")
    if done.long:
        print(f"kept open: {counted(len(done.long), 'hole')} of more than {max_edges} edges (--max-edges)")


def _option(name: str, value: object) -> str:
    option = CONTROL_OPTIONS[name].option.removeprefix("--")
    if isinstance(value, list | tuple):
        value = ", ".join(map(str, value))
    text = f"{value:g}" if isinstance(value, float) else value
    return option if CONTROL_OPTIONS[name].about.flag else f"{option} {text}"


def print_left_out(losses: Sequence[str]) -> None:
    for loss in losses:
        notify(f"left out: {loss}")


def print_inspection(found: "Inspection") -> None:
    from cascadenorm.api.inspection import FINDINGS

    loops = f"{counted(found.boundary_loops, 'boundary loop')} with {counted(found.boundary_edges, 'edge')}"
    kind = "closed" if found.closed else f"open: {loops}"
    genus = f", genus {found.genus}" if found.genus is not None else ""
    euler = f"Euler characteristic {found.euler_characteristic}{genus}"
    copies = found.file_vertices - found.vertices
    vertices = counted(found.vertices, "vertex", "vertices")
    print(f"{found.source}: {vertices}, {counted(found.faces, 'face')}, {found.number_type}")
    if copies:
        which = counted(copies, "is a copy", "are copies")
        print(f"  the file stores {found.file_vertices} vertices, of which {which} of others")
    if found.lower is not None and found.upper is not None:
        print(f"  connected components: {found.parts}; {kind}; {euler}")
        print(f"  bounding box from {_numbers(found.lower)} to {_numbers(found.upper)}")
        print(
            f"  mean edge length {_number(found.mean_edge_length)}, area {_number(found.area)}, "
            f"enclosed volume {_number(found.volume)}"
        )
    noise = "cannot be estimated"
    if found.noise is not None:
        noise = f"{'below 0.001' if found.noise < 0.001 else f'about {found.noise:.2g}'} mean edge lengths"
    print(f"  noise along the normal: {noise}")
    if found.error is not None and found.noise is not None:
        print(f"  kind of error: {found.error}")
    if found.treated_as is not None:
        print(f"  treated as: {found.treated_as}")
    wide = found.treads or found.bumps
    if wide is not None:
        width = math.ceil(wide.width)
        what, cause = f"bumps about {width} edges wide cover the surface", "particles"
        if found.treads is not None:
            what, cause = f"{found.treads.count} flat, parallel steps, about {width} edges wide", "rounded depths"
        print(f'  {what}; if they are an error, as of {cause}, remove them with --remove-detail "{width} edges"')
    if found.resolution is not None and found.resolution > COARSE_RESOLUTION:
        print(
            f"  {found.number_type} is too coarse at these coordinates: its resolution is {found.resolution:.2g} mean "
            "edge lengths; write float64 numbers, or move the mesh to the origin first"
        )
    for name, places in found.findings.items():
        first = ", ".join("-".join(map(str, p)) if isinstance(p, tuple) else str(p) for p in places.first)
        more = ", …" if places.count > len(places.first) else ""
        print(f"  {counted(places.count, *FINDINGS[name])}: {first}{more}")
    if found.crossing_faces is None:
        print("  self-intersections were not checked: pass --self-intersections")
    if not found.findings:
        print("  no defects" if found.faces else "  it has no faces")
    else:
        print(f"  (vertices and faces are counted from {found.counts_from})")


def _numbers(values: Sequence[float]) -> str:
    return f"({', '.join(f'{value:.9g}' for value in values)})"


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.6g}"


def print_measures(measures: "Measures") -> None:
    _print_table(("measure", "value"), "lr", measures.formatted().items())


def print_spectrum(found: "Spectrum") -> None:
    """Print the eigenvalues of one mesh, or of two side by side with the distance of their spectra."""
    columns = {"eigenvalue" if found.scale == "keep" else "eigenvalue × area": found.values}
    if found.other is not None:
        columns["of the other"] = found.other
    every = enumerate(zip(*columns.values(), strict=True), start=1)
    rows = ((str(number), *(f"{value:.6g}" for value in values)) for number, values in every)
    _print_table(("", *columns), "r" * (1 + len(columns)), rows)
    if found.distance is not None:
        print(f"distance: {found.distance:.6g}")


def print_public_sets() -> None:
    from cascadenorm.evaluation.public_sets import PUBLIC_SETS

    for name, one in PUBLIC_SETS.items():
        print(f"{name}: {one.about} ({one.source})\n    {one.place}")


def print_evaluation(done: "Evaluation") -> None:
    """Print one line per pair and method, and the mean of each method."""
    from rich.text import Text

    from cascadenorm.evaluation.tables import PARTIAL_NOTE, TERMINAL_COLUMNS, means_table, method_table, spread_table

    pairs = list(dict.fromkeys(result.pair for result in done.results))
    blocks = [method_table([one for one in done.results if one.pair == pair], pair, TERMINAL_COLUMNS) for pair in pairs]
    blocks.append(means_table(done, "mean", TERMINAL_COLUMNS)._replace(title="mean"))
    head = ["pair", *(title.replace(" (", "\n").rstrip(")") for title in blocks[0].head)]
    rows = list[Sequence["str | Text"] | None]()
    for block in blocks:
        for number, row in enumerate(block.rows):
            cells = [Text(cell.text, style="bold" if cell.best else "") for cell in row]
            rows.append(["" if number else block.title, *cells])
        rows.append(None)
    caption = PARTIAL_NOTE.strip(" ()") if done.partial else None
    _print_table(head, "ll" + "r" * (len(head) - 2), rows, caption=caption)
    if len(set(done.seeds.values())) > 1:
        over = spread_table(done)
        texts = ([cell.text for cell in row] for row in over.rows)
        _print_table(over.head, "l" * len(over.head), texts, title=over.title)


def print_curves(passes: "Sequence[Pass]") -> None:
    """Print one line per network: its epochs, the best validation result, and the course of the error."""
    rows = []
    for (stage, cluster), group in groupby(passes, key=lambda done: (done.stage, done.cluster)):
        of_network = list(group)
        best = min(of_network, key=lambda done: done.validation)
        numbers = [stage, cluster, of_network[-1].epoch, best.epoch]
        figures = [f"{best.loss:.4f}", f"{best.validation:.4f}", f"{best.validation_deg:.2f}°"]
        rows.append([*map(str, numbers), *figures, sparkline([done.validation_deg for done in of_network])])
    head = ("stage", "cluster", "epochs", "best", "loss", "validation", "error", "error by epoch")
    _print_table(head, "rrrrrrrl", rows)


def sparkline(values: Sequence[float]) -> str:
    """Return a text bar chart of at most CHART_WIDTH values, scaled from the smallest to the largest."""
    width = min(CHART_WIDTH, len(values))
    shown = [values[i * len(values) // width] for i in range(width)]
    low, high = min(shown), max(shown)
    return "".join(BARS[round((len(BARS) - 1) * (value - low) / (high - low or 1))] for value in shown)


def print_methods(methods: "Mapping[str, Method]") -> None:
    rows = (
        (method.name, method.summary, ", ".join(setting.name for setting in method.given_by_name), method.source)
        for method in methods.values()
    )
    _print_table(("method", "what it does", "parameters", "source"), "llll", rows)


def print_method(method: "Method") -> None:
    """Print the summary, formula, limits and parameters of a method."""
    print(f"{method.name}: {method.summary}\nSource: {method.source}")
    for title in ("Formula", "Limits"):
        if text := method.section(title):
            print(f"{title}:\n{indent(text, '  ')}")
    rows = (
        (one.name, str(one.default), one.about.unit, allowed_values(one), one.about.help)
        for one in method.given_by_name
    )
    _print_table(("parameter", "default", "unit", "allowed", "meaning"), "lllll", rows)


def allowed_values(setting: "Setting") -> str:
    """Return the values that a parameter accepts, in words."""
    return ", ".join(map(str, setting.choices)) or setting.about.allowed


def _print_table(
    head: Sequence[str],
    align: str,
    rows: "Iterable[Sequence[str | Text] | None]",
    *,
    title: str | None = None,
    caption: str | None = None,
) -> None:
    """Print a table with the width of the terminal, or with PLAIN_WIDTH characters.

    Each column is aligned to the left, "l", or to the right, "r". A row of None draws a line.
    """
    from rich.console import Console  # slow to import, and most commands print no table
    from rich.table import Table

    table = Table(title=title, caption=caption)
    for name, side in zip(head, align, strict=True):
        table.add_column(name, justify="right" if side == "r" else "left")
    for row in rows:
        if row is None:
            table.add_section()
        else:
            table.add_row(*row)
    Console(width=None if sys.stdout.isatty() else PLAIN_WIDTH, markup=False, emoji=False).print(table)


def print_json(command: str, content: Mapping[str, Any], *, file: TextIO | None = None) -> None:
    """Print the JSON object of a command to stdout or another file, as specified in docs/json.md."""
    from cascadenorm.io.json_text import json_text

    print(json_text({"version": SCHEMA_VERSION, "command": command, **content}, indent=2), file=file)


def faults_json(before: "Mesh", after: "Mesh") -> dict[str, Any]:
    """Return the numbers of intersecting faces, spikes and folded edges before and after denoising."""
    from cascadenorm.api.inspection.inspection import surface_faults

    first, last = surface_faults(before), surface_faults(after)
    return {name: {"before": first[name], "after": last[name]} for name in first}


def method_json(method: "Method") -> dict[str, Any]:
    return {
        "name": method.name,
        "summary": method.summary,
        "source": method.source,
        "parameters": [
            {
                "name": setting.name,
                "default": setting.default,
                "unit": setting.about.unit,
                "allowed": allowed_values(setting),
                "help": setting.about.help,
            }
            for setting in method.given_by_name
        ],
    }
