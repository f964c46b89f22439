"""Make every table and figure of a page about accuracy from a folder of pairs: python benchmarks/reproduce.py DIR OUT

OUT gets `results.md`, a page with all of them and with what made them; `table.csv` and `tables.tex`; `evaluation.html`
with figures, error maps and a viewer for each pair; `method.png`. Needs the extra `reproduce`. DIR holds pairs,
*/noisy.* and */clean.*; docs/data.md says where the public ones are. Evaluations that were interrupted go on.
"""

import argparse
import contextlib
import io
import platform
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import harm
import low_noise
import method_figure

from cascadenorm.cli import run
from cascadenorm.evaluation.harness import DEFAULT_METHODS
from cascadenorm.io.digests import file_digest
from cascadenorm.io.pairs import find_pairs
from cascadenorm.learned.methods import weights_file
from cascadenorm.models.models import SHIPPED

PACKAGES = ("cascadenorm", "numpy", "scipy", "numba", "matplotlib")

PAGE = """\
# Results

## Accuracy on the pairs

{accuracy}

[Figures, error maps and a viewer for each pair](evaluation.html)

## Spread over five seeds of noise of 0.2 mean edge lengths

{spread}

## Clean and nearly clean meshes

Mean angle over the meshes in degrees, that of the worst in brackets; noise in mean edge lengths.

{begin}
{end}

## Harm to clean CAD parts

Mean angle by area between the normals before and after, largest displacement in per cent of the diagonal, flipped
faces, change of volume.

```
{harm}
```

## The method

![One stage of the cascade on a machine part](method.png)

## Made with

{made_with}
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Make everything and say where the page is."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR", help="pairs: */noisy.* and */clean.*")
    parser.add_argument("out", type=Path, metavar="OUT", help="folder for the page; it is made")
    parser.add_argument("--method", action="append", help="may be given several times")
    parser.add_argument("--parts", type=int, default=20, help="CAD parts of the table of harm")
    chosen = parser.parse_args(arguments)
    chosen.out.mkdir(parents=True, exist_ok=True)
    page, methods = chosen.out / "results.md", chosen.method or list(DEFAULT_METHODS)
    asked = [word for method in methods for word in ("--method", method)]

    files = ["--csv", "table.csv", "--latex", "tables.tex", "--markdown", "tables.md", "--html", "evaluation.html"]
    command(str(chosen.folder), *asked, *[w if w.startswith("--") else str(chosen.out / w) for w in files])
    noise = ["--noise", "0.2", "--seeds", "5", "--keep", str(chosen.out / "seeds")]
    command(str(chosen.folder), *asked, *noise, "--markdown", str(chosen.out / "spread.md"))
    method_figure.main(["--output", str(chosen.out / "method.png")])
    with contextlib.redirect_stdout(io.StringIO()) as lines:
        harm.main(["--parts", str(chosen.parts)])
    text = PAGE.format(
        accuracy=(chosen.out / "tables.md").read_text(encoding="utf-8"),
        spread=(chosen.out / "spread.md").read_text(encoding="utf-8").rpartition("Mean ± ")[2].partition("\n\n")[2],
        begin=low_noise.BEGIN, end=low_noise.END, harm=lines.getvalue(), made_with=made_with(chosen.folder),
    )  # fmt: skip
    page.write_text(text, encoding="utf-8")
    low_noise.main([str(chosen.folder), "--text", str(page), *asked])
    print(page)


def command(*words: str) -> None:
    """Evaluate; what fails ends everything."""
    if code := run(["evaluate", *words, "--force"]):
        raise SystemExit(code)


def made_with(folder: Path) -> str:
    """Return versions, and digests of weights and meshes, so that the same can be made again."""
    versions = [f"- {name} {version(name)}" for name in PACKAGES]
    weights = [f"- weights `{name}`: `{file_digest(weights_file(name))}`" for name in SHIPPED]
    meshes = [
        f"- `{pair.name}`: `{file_digest(pair.noisy)}`, `{file_digest(pair.clean)}`" for pair in find_pairs(folder)
    ]
    return "\n".join([f"- Python {platform.python_version()}", *versions, *weights, *meshes])


if __name__ == "__main__":
    main()
