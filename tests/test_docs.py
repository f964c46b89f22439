"""Links, names, commands and Python blocks in the documents."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *(ROOT / "benchmarks").glob("*.md")])
FENCE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def anchors(page: Path) -> set[str]:
    """The anchors that GitHub gives to the headings of a page."""
    headings = re.findall(r"^#+ (.+)$", FENCE.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_links_lead_to_files_and_headings(page):
    for link in re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", page.read_text(encoding="utf-8"))):
        if link.startswith(("https://", "http://")):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), f"{link}: {named(target)} has no such heading"


def test_the_architecture_names_only_what_exists():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    for row in re.findall(r"^\|(.+)\|$", text[text.index("## Folders") :], re.MULTILINE)[2:]:
        where, _, modules = row.split("|")
        folders = [ROOT / name for name in re.findall(r"`([^`]+/)`", where)] or [ROOT / "cascadenorm"]
        for name in re.findall(r"`([^`<]+)`", modules):
            places = [folder.parent / name for folder in folders] + [folder / name for folder in folders]
            found = any(place.exists() or place.with_name(f"{name}.py").exists() for place in places)
            assert found, f"there is no {name} in{where}"
