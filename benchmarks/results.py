"""Records of measurements in JSON files, and the tables that pages show from them.

    python -m benchmarks.results [NAME ...]

A benchmark prints its table. With `--record` it also writes its figures to benchmarks/records/NAME.json and the table
into a page, between the markers `<!-- NAME: ... -->` and `<!-- end of NAME -->`. The command above writes the tables of
all records, or of those named, into their pages again.
"""

import argparse
import importlib
import json
import platform
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cascadenorm.mesh import thread_count

ROOT = Path(__file__).parents[1]
FOLDER = Path("benchmarks", "records")
PAGES = {
    "public-pairs": ("README.md", "accuracy.pairs.table"),
    "validation": ("benchmarks/accuracy.md", "accuracy.pairs.table"),
    "low-noise": ("benchmarks/accuracy.md", "accuracy.clean.low_noise_table"),
    "packaged-models": ("benchmarks/accuracy.md", "accuracy.packaged_models.table"),
    "real-errors": ("benchmarks/accuracy.md", "accuracy.kinds.table"),
    "peers": ("benchmarks/accuracy.md", "accuracy.kinds.peer_table"),
    "elongated": ("benchmarks/accuracy.md", "accuracy.generated.table"),
    "extractors": ("benchmarks/accuracy.md", "accuracy.generated.table"),
    "levels": ("benchmarks/accuracy.md", "accuracy.generated.table"),
    "decimated": ("benchmarks/accuracy.md", "accuracy.generated.table"),
    "reliefs": ("benchmarks/accuracy.md", "accuracy.generated.table"),
    "scans": ("benchmarks/accuracy.md", "accuracy.scans.table"),
    "ablation": ("benchmarks/ablation.md", "accuracy.ablation.table"),
    "controls": ("benchmarks/controls.md", "accuracy.controls.table"),
    "commands": ("benchmarks/speed.md", "speed.commands.table"),
    "first-run": ("benchmarks/speed.md", "speed.commands.first_run_table"),
    "files": ("benchmarks/speed.md", "speed.files.table"),
    "file-memory": ("docs/files.md", "speed.files.memory_table"),
    "methods": ("benchmarks/speed.md", "speed.methods.table"),
    "harmonics": ("benchmarks/speed.md", "speed.methods.harmonics_table"),
    "opening": ("benchmarks/speed.md", "speed.opening.table"),
    "large-meshes": ("docs/patches.md", "speed.scale.table"),
    "plan": ("benchmarks/scale.md", "speed.scale.plan_table"),
    "kernels": ("benchmarks/performance.md", "speed.kernels.table"),
    "malformed": ("benchmarks/dirty_input.md", "robustness.malformed.table"),
    "round-trips": ("docs/other-programs.md", "robustness.round_trips.table"),
}
"""The page that shows each record, and the function that makes its table from the figures."""

Figures = Mapping[str, Any]
Table = Callable[[Figures], str]


def main(arguments: Sequence[str] | None = None) -> None:
    """Write the tables of the records into their pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="record; default: all of them")
    for name in parser.parse_args(arguments).names or PAGES:
        show(name)


def add_option(parser: argparse.ArgumentParser, name: str | None = None) -> None:
    """Add the option `--record`, which takes the name of a record unless a script has only one."""
    text = "write the figures to benchmarks/records/ and the table into the page that shows them"
    if name:
        parser.add_argument("--record", action="store_const", const=name, help=f"{text}, as {name}")
    else:
        parser.add_argument("--record", metavar="NAME", help=f"{text}, under this name")


def report(name: str | None, figures: Figures, table: Table, *, root: Path = ROOT) -> None:
    """Print the table of the figures; if a record is named, write it, and show the table in its page if it has one."""
    print(table(figures))
    if name:
        write(name, figures, root=root)
        if name in PAGES:
            show(name, root=root)


def read(name: str, *, root: Path = ROOT) -> dict[str, Any]:
    """Return the figures of a record."""
    found: dict[str, Any] = json.loads((root / FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    return found


def write(name: str, figures: Figures, *, root: Path = ROOT) -> None:
    """Write the figures of a record."""
    text = json.dumps(figures, indent=1, ensure_ascii=False)
    (root / FOLDER / f"{name}.json").write_text(text + "\n", encoding="utf-8", newline="\n")


def show(name: str, *, root: Path = ROOT) -> None:
    """Write the table of a record into its page."""
    place, function = PAGES[name]
    page = root / place
    text = with_table(page.read_text(encoding="utf-8"), name, table_of(function)(read(name, root=root)))
    page.write_text(text, encoding="utf-8", newline="\n")


def table_of(function: str) -> Table:
    """Import a function by its path below `benchmarks`, when needed: some benchmarks need extra packages."""
    module, _, name = function.rpartition(".")
    found: Table = getattr(importlib.import_module(f"benchmarks.{module}"), name)
    return found


def with_table(page: str, name: str, table: str) -> str:
    """Return a page with the table between the markers of a record replaced."""
    begin, end = f"<!-- {name}: ", f"<!-- end of {name} -->"
    if page.count(begin) != 1 or page.count(end) != 1:
        raise SystemExit(f"the page must contain '{begin}... -->' and '{end}' exactly once")
    head, _, rest = page.partition(begin)
    comment = rest.partition("-->")[0]
    return f"{head}{begin}{comment}-->\n{table.strip()}\n{end}{page.partition(end)[2]}"


def markdown(titles: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: bool = True) -> str:
    """Return a Markdown table; columns of numbers, all but the first, are aligned to the right."""
    rule = ["---"] + ["---:" if numbers else "---"] * (len(titles) - 1)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (titles, rule, *rows))


def machine() -> str:
    """Return a description of the machine and the versions."""
    return f"{thread_count()} threads, {platform.system()} {platform.machine()}, Python {platform.python_version()}"


if __name__ == "__main__":
    main()
