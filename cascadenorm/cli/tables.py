"""What the command line shows: tables for people, one JSON object for machines, progress on a terminal."""

import csv
import io
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TextIO

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from cascadenorm.api import Report
from cascadenorm.evaluation.harness import COLUMNS, Evaluation, Result
from cascadenorm.evaluation.metrics import Measures
from cascadenorm.inspection import Inspection
from cascadenorm.io.atomic import write_atomically
from cascadenorm.learned import launch
from cascadenorm.messages import counted
from cascadenorm.registry import Method, Setting

JSON_VERSION = 1
COARSE = 0.01
"""Steps of the number type, in mean edge lengths, from which on they are spoken of."""
PLAIN_WIDTH = 120
"""Columns of a table that does not go to a terminal."""


def print_json(command: str, content: Mapping[str, Any], *, file: TextIO | None = None) -> None:
    """Print a result with the command that made it and the version of the format."""
    found = {"version": JSON_VERSION, "command": command, **content}
    print(json.dumps(found, indent=2, default=str, allow_nan=False), file=file)


UNTOUCHED = {"strength": 1.0, "boundary": "free", "on_bad": "error"}
"""Controls that change nothing unless they are otherwise; all others do so unless they are None."""


def print_denoised(done: Report, *, file: TextIO) -> None:
    """Print what was done to a file."""
    print(f"{done.source} -> {done.output}", file=file)
    print(
        f"{done.method}: {counted(done.faces, 'face')} in {done.seconds:.2f} s; "
        f"{done.moved} of {counted(done.vertices, 'vertex', 'vertices')} moved, "
        f"by {done.mean_displacement:.3g} mean edge lengths on average, {done.largest_displacement:.3g} at most",
        file=file,
    )
    controls = {"strength": done.strength, **done.controls}
    chosen = [f"{name.replace('_', '-')} {value}" for name, value in controls.items() if value != UNTOUCHED.get(name)]
    if chosen:
        print(f"controls: {', '.join(chosen)}", file=file)
    if done.isolated_vertices or done.isolated_faces:
        vertices = counted(done.isolated_vertices, "vertex that is not finite", "vertices that are not finite")
        bad = f"{vertices}, {counted(done.isolated_faces, 'face')}"
        print(f"cascadenorm: left alone as bad: {bad}", file=sys.stderr)
    print_left_out(done.left_out)


def print_left_out(losses: Sequence[str]) -> None:
    """Say what an output could not keep."""
    for loss in losses:
        print(f"cascadenorm: left out: {loss}", file=sys.stderr)


FINDINGS = {
    "bad_indices": ("face names a vertex that does not exist", "faces name vertices that do not exist"),
    "not_finite": ("vertex is not finite", "vertices are not finite"),
    "repeated_corners": ("face names a vertex twice", "faces name a vertex twice"),
    "non_manifold_edges": ("edge has more than two faces", "edges have more than two faces"),
    "non_manifold_vertices": (
        "vertex joins faces that do not hang together there",
        "vertices join faces that do not hang together there",
    ),
    "turned_edges": (
        "edge lies between faces of which one is turned over",
        "edges lie between faces of which one is turned over",
    ),
    "inside_out": ("closed part is inside out, or a cavity", "closed parts are inside out, or cavities"),
    "zero_area": ("face has no area", "faces have no area"),
    "slivers": ("face is a sliver, less than 1 % as high as long", "faces are slivers, less than 1 % as high as long"),
    "duplicate_faces": ("face repeats an earlier one", "faces repeat an earlier one"),
    "unreferenced": ("vertex belongs to no face", "vertices belong to no face"),
    "duplicate_vertices": (
        "vertex lies where an earlier one does, but is not joined to it",
        "vertices lie where an earlier one does, but are not joined to it",
    ),
    "crossing_faces": ("face passes through others", "faces pass through others"),
}
"""What is said of each finding of an inspection, after the number of places: of one, and of several."""


def print_inspection(found: Inspection) -> None:
    """Print what a mesh is and what was found in it, a line each."""
    rims = f"{counted(found.rims, 'rim')}, {counted(found.boundary_edges, 'edge')} long in all"
    kind = "closed" if found.closed else f"open: {rims}"
    handles = f", genus {found.genus}" if found.genus is not None else ""
    copies = found.file_vertices - found.vertices
    vertices = counted(found.vertices, "vertex", "vertices")
    print(f"{found.source}: {vertices}, {counted(found.faces, 'face')}, {found.number_type}")
    if copies:
        which = counted(copies, "is a copy", "are copies")
        print(f"  the file splits vertices: it has {found.file_vertices}, of which {which}")
    if found.lower is not None and found.upper is not None:
        print(f"  parts: {found.parts}; {kind}; Euler characteristic {found.euler_characteristic}{handles}")
        print(f"  box from {_numbers(found.lower)} to {_numbers(found.upper)}")
        print(
            f"  mean edge length {_number(found.mean_edge_length)}, area {_number(found.area)}, "
            f"enclosed volume {_number(found.volume)}"
        )
    noise = "not to be told" if found.noise is None else f"about {found.noise:.2g} mean edge lengths"
    print(f"  noise along the normal: {noise}")
    if found.resolution is not None and found.resolution > COARSE:
        print(
            f"  {found.number_type} is too coarse at these coordinates: its steps are {found.resolution:.2g} mean edge "
            "lengths; write float64 numbers, or move the mesh to the origin first"
        )
    for name, places in found.findings.items():
        first = ", ".join("-".join(map(str, p)) if isinstance(p, tuple) else str(p) for p in places.first)
        more = ", …" if places.count > len(places.first) else ""
        print(f"  {counted(places.count, *FINDINGS[name])}: {first}{more}")
    if found.crossing_faces is None:
        print("  faces that pass through others were not looked for; --self-intersections does")
    if not found.findings:
        print("  nothing is wrong with it" if found.faces else "  it has no faces")
    else:
        print(f"  (places are numbers of vertices or faces, counted from {found.counts_from})")


def _numbers(values: Sequence[float]) -> str:
    return f"({', '.join(f'{value:.9g}' for value in values)})"


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.6g}"


def print_measures(measures: Measures) -> None:
    """Print the measures of one mesh."""
    table = Table()
    table.add_column("measure")
    table.add_column("value", justify="right")
    ratio = measures.volume_ratio
    for name, value in (
        ("normal error E_a, mean", f"{measures.normal_error_deg:.3f} deg"),
        ("normal error, root mean square", f"{measures.normal_error_rms_deg:.3f} deg"),
        ("normal error, 95 % of the faces", f"{measures.normal_error_p95_deg:.3f} deg"),
        ("faces turned by more than 90 deg", f"{measures.turned_percent:.3f} %"),
        ("vertex error E_v, mean", f"{measures.vertex_error_edges:.4f} mean edge lengths"),
        ("Hausdorff distance", f"{measures.hausdorff_diagonal:.5f} diagonals"),
        ("volume ratio", "open" if ratio is None else f"{ratio:.6f}"),
    ):
        table.add_row(name, value)
    print_table(table)


def print_evaluation(done: Evaluation) -> None:
    """Print a line for each pair and method, and the mean of each method."""
    table = Table()
    table.add_column("pair")
    table.add_column("method")
    for title in ("E_a deg", "E_v edges", "turned %", "Hausdorff", "volume", "seconds"):
        table.add_column(title, justify="right")
    last = None
    for result in done.results:
        if last not in (None, result.pair):
            table.add_section()
        table.add_row(*_cells(result, name="" if result.pair == last else result.pair))
        last = result.pair
    for number, result in enumerate(done.means):
        if number == 0:
            table.add_section()
        table.add_row(*_cells(result, name="mean" if number == 0 else ""), style="bold")
    print_table(table)


def _cells(result: Result, *, name: str) -> tuple[str, ...]:
    measures = result.measures
    return (
        name,
        result.method,
        f"{measures.normal_error_deg:.2f}",
        f"{measures.vertex_error_edges:.3f}",
        f"{measures.turned_percent:.3f}",
        f"{measures.hausdorff_diagonal:.4f}",
        "open" if measures.volume_ratio is None else f"{measures.volume_ratio:.4f}",
        f"{result.seconds:.2f}" if result.seconds else "",
    )


def evaluation_object(done: Evaluation) -> dict[str, Any]:
    """Return an evaluation as JSON can hold it."""
    return {
        "results": [result.row() for result in done.results],
        "means": [result.row() for result in done.means],
        "failures": [{"pair": f.pair, "method": f.method, "message": str(f.error)} for f in done.failures],
    }


def write_table(path: Path, done: Evaluation, *, force: bool) -> None:
    """Write a line for each pair and method as comma-separated values, the names of the columns first."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(result.row() for result in done.results)
    write_atomically(path, [text.getvalue().encode()], force=force)


def print_methods(methods: Mapping[str, Method]) -> None:
    """Print each method with its parameters and its source."""
    table = Table()
    for title in ("method", "what it does", "parameters", "source"):
        table.add_column(title)
    for method in methods.values():
        names = ", ".join(setting.name for setting in method.given_by_name)
        table.add_row(method.name, method.summary, names, method.source)
    print_table(table)


def print_method(method: Method) -> None:
    """Print the parameters of one method."""
    print(f"{method.name}: {method.summary}\nSource: {method.source}")
    table = Table()
    for title in ("parameter", "default", "unit", "allowed", "meaning"):
        table.add_column(title)
    for setting in method.given_by_name:
        table.add_row(setting.name, str(setting.default), setting.about.unit, _allowed(setting), setting.about.help)
    print_table(table)


def method_object(method: Method) -> dict[str, Any]:
    """Return a method as JSON can hold it."""
    return {
        "name": method.name,
        "summary": method.summary,
        "source": method.source,
        "parameters": [
            {
                "name": setting.name,
                "default": _finite(setting.default),
                "unit": setting.about.unit,
                "allowed": _allowed(setting),
                "help": setting.about.help,
            }
            for setting in method.given_by_name
        ],
    }


def _allowed(setting: Setting) -> str:
    return ", ".join(map(str, setting.choices)) or setting.about.allowed


def _finite(value: Any) -> Any:
    """Return text for a number that JSON does not have."""
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


@contextmanager
def progress_bar(text: str) -> Iterator[Callable[[float], object]]:
    """Show the share that is done, on a terminal."""
    with _progress() as bar:
        task = bar.add_task(text, total=1.0)
        yield lambda share: bar.update(task, completed=share)


@contextmanager
def progress_steps() -> Iterator[Callable[[str, int, int], object]]:
    """Show what is being done and how many parts are done, on a terminal."""
    with _progress() as bar:
        task = bar.add_task("", total=None)
        yield lambda text, done, total: bar.update(task, description=text, completed=done, total=total)


@contextmanager
def progress_tasks() -> Iterator[launch.Progress]:
    """Show tasks as they begin and end, several at once: bars on a terminal, else a line for each that is finished."""
    with _progress() as bar:
        started: dict[str, TaskID] = {}

        def show(task: str, done: int, total: int, note: str = "") -> None:
            if task not in started:
                started[task] = bar.add_task(task, total=total)
            text = f"{task}  {note}" if note else task
            bar.update(started[task], completed=done, description=text)
            if done == total:
                bar.remove_task(started.pop(task))
                bar.console.print(f"{text}: done", highlight=False)

        yield show


def _progress() -> Progress:
    console = Console(stderr=True, markup=False)
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def print_table(table: Table) -> None:
    """Print a table, as wide as the terminal or as PLAIN_WIDTH."""
    console = Console(width=None if sys.stdout.isatty() else PLAIN_WIDTH, markup=False, emoji=False)
    console.print(table)
