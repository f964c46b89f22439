"""Make every table and figure of a page about accuracy from a folder of pairs.

    python -m benchmarks.accuracy.reproduce PAIRS OUT [--method NAME ...] [--parts 20]

OUT gets `results.md`, a page with all of them and their provenance; `table.csv` and `tables.tex`; `evaluation.html`
with figures, error maps and a viewer for each pair; `method.png`. Needs the extra `reproduce`. PAIRS holds pairs,
*/noisy.* and */clean.*; docs/data.md says where to get the public ones. Interrupted evaluations resume.
"""

import argparse
import platform
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from benchmarks.accuracy import clean
from cascadenorm.cli import run
from cascadenorm.evaluation.harness import DEFAULT_METHODS
from cascadenorm.io.digests import file_digest
from cascadenorm.io.pairs import find_pairs
from cascadenorm.learned.methods import SHIPPED, weights_file

METHOD_FIGURE = Path(__file__).parents[2] / "docs" / "generate" / "method_figure.py"
PACKAGES = ("cascadenorm", "numpy", "scipy", "numba", "matplotlib")
LEVELS = (0.0, 0.01, 0.03)

PAGE = """\
# Results

## Accuracy on the pairs

{accuracy}

[Figures, error maps and a viewer for each pair](evaluation.html)

## Spread over five seeds of noise of 0.2 mean edge lengths

{spread}

## Clean and nearly clean meshes

Mean angle over the meshes in degrees, that of the worst in brackets; noise in mean edge lengths.

{low_noise}

## Clean CAD parts

Changes made by `auto` to generated parts, which should stay as they are.

{parts}

## The method

![One stage of the cascade on a machine part](method.png)

## Provenance

{provenance}
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Make everything and print the path of the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="PAIRS", help="folder of */noisy.* and */clean.*")
    parser.add_argument("out", type=Path, metavar="OUT", help="folder for the page; it is created")
    parser.add_argument("--method", action="append", help="may be given several times")
    parser.add_argument("--parts", type=int, default=20, help="generated CAD parts")
    options = parser.parse_args(arguments)
    folder, out, methods = options.folder, options.out, options.method or list(DEFAULT_METHODS)
    out.mkdir(parents=True, exist_ok=True)
    asked = [word for method in methods for word in ("--method", method)]

    files = {"--csv": "table.csv", "--latex": "tables.tex", "--markdown": "tables.md", "--html": "evaluation.html"}
    evaluated(folder, *asked, *[word for option, name in files.items() for word in (option, out / name)])
    evaluated(
        folder, *asked, *("--noise", "0.2", "--seeds", "5"), "--keep", out / "seeds", "--markdown", out / "spread.md"
    )
    subprocess.run([sys.executable, METHOD_FIGURE, "--output", out / "method.png"], check=True)
    spread = (out / "spread.md").read_text(encoding="utf-8").rpartition("Mean ± ")[2].partition("\n\n")[2]
    text = PAGE.format(
        accuracy=(out / "tables.md").read_text(encoding="utf-8"),
        spread=spread,
        low_noise=clean.low_noise_table(clean.low_noise(clean.clean_meshes(folder), methods, LEVELS)),
        parts=clean.table(clean.changes(clean.clean_meshes(None, options.parts), ["auto"])),
        provenance=provenance(folder),
    )
    (out / "results.md").write_text(text, encoding="utf-8")
    print(out / "results.md")


def evaluated(*words: str | Path) -> None:
    """Evaluate through the command line; a failure stops the script."""
    if code := run(["evaluate", *map(str, words), "--force"]):
        raise SystemExit(code)


def provenance(folder: Path) -> str:
    """Return versions, and digests of weights and meshes, so that everything can be reproduced."""
    versions = [f"- {name} {version(name)}" for name in PACKAGES]
    weights = [f"- weights `{name}`: `{file_digest(weights_file(name))}`" for name in SHIPPED]
    meshes = [
        f"- `{pair.name}`: `{file_digest(pair.noisy)}`, `{file_digest(pair.clean)}`" for pair in find_pairs(folder)
    ]
    return "\n".join([f"- Python {platform.python_version()}", *versions, *weights, *meshes])


if __name__ == "__main__":
    main()
