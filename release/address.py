"""Write the address of the repository into every page, notebook and manifest that names it.

    python release/address.py https://github.com/acme/cascadenorm

`pyproject.toml` has the address that holds now; OWNER in it stands for one that is not known yet.
"""

import argparse
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PATTERNS = ("pyproject.toml", "README.md", "CITATION.cff", "docs/*.md", "notebooks/*.ipynb", "examples/*/*.md")
UNKNOWN = "OWNER/cascadenorm"
NOTE = " Replace `OWNER` with the owner of the repository."
"""Stands where commands have the address, as long as it is not known."""


def main(arguments: list[str] | None = None, root: Path = ROOT) -> None:
    """Replace the address that holds now, and list the files that have changed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("address", help="such as https://github.com/acme/cascadenorm")
    given = parser.parse_args(arguments).address
    found = re.fullmatch(r"https://github\.com/([\w.-]+/[\w.-]+?)(?:\.git)?/?", given)
    if found is None:
        parser.error(f"{given} is no address like https://github.com/acme/cascadenorm")
    before = repository(root)
    for path in files(root):
        old = path.read_text(encoding="utf-8")
        new = named(old, before, found[1])
        if new != old:
            path.write_text(new, encoding="utf-8", newline="\n")
            print(path.relative_to(root).as_posix())


def repository(root: Path = ROOT) -> str:
    """Return owner and name of the repository, as pyproject.toml has them."""
    text = (root / "pyproject.toml").read_text(encoding="utf-8")
    found = re.search(r'^Repository = "https://github\.com/([^"]+)"$', text, re.MULTILINE)
    if found is None:
        raise SystemExit('pyproject.toml has no line Repository = "https://github.com/OWNER/cascadenorm"')
    return found[1]


def files(root: Path = ROOT) -> list[Path]:
    """Return the files that may have the address; docs/releasing.md shows one that is made up."""
    return sorted(path for pattern in PATTERNS for path in root.glob(pattern) if path.name != "releasing.md")


def named(text: str, before: str, after: str) -> str:
    """Return a text with another repository in addresses of GitHub and Colab, and in steps of workflows."""
    text = re.sub(rf"(github\.com/|/github/|uses: ){re.escape(before)}(?![\w-])", rf"\g<1>{after}", text)
    return text if after == UNKNOWN else text.replace(NOTE, "")


if __name__ == "__main__":
    main()
