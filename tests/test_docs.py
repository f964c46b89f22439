"""Links, names, commands and Python blocks in the documents."""

import importlib
import re
import sys
from pathlib import Path

import pytest
from shapes import icosphere

from cascadenorm.interop import save_mesh

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

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


def test_the_readme_names_every_extra():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    with (ROOT / "pyproject.toml").open("rb") as file:
        extras = set(tomllib.load(file)["project"]["optional-dependencies"])
    assert set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)) >= extras - {"dev"}


def test_the_pairs_of_the_readme_are_collected_from_clones(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    script = importlib.import_module("collect_pairs")
    page = (ROOT / "docs" / "data.md").read_text(encoding="utf-8")
    for name, source in {**script.GUIDED, **script.MESH_TGV}.items():
        (row,) = re.findall(rf"^\| {name} \|.*$", page, re.MULTILINE)
        assert f"`{source.noisy}` | `{source.clean}` | {source.faces:,} |" in row
    monkeypatch.setattr(script, "GUIDED", {"ball": script.Source("n.obj", "c.obj", 42, 80)})
    monkeypatch.setattr(script, "MESH_TGV", {})
    for name in ("n.obj", "c.obj"):
        save_mesh(tmp_path / name, icosphere(1))
    script.main([str(tmp_path), str(tmp_path), str(tmp_path / "pairs")])
    assert (tmp_path / "pairs" / "ball" / "clean.obj").read_bytes() == (tmp_path / "c.obj").read_bytes()
    save_mesh(tmp_path / "c.obj", icosphere(2), force=True)
    with pytest.raises(SystemExit, match="162 vertices and 320 faces; the mesh that was measured has 42 and 80"):
        script.main([str(tmp_path), str(tmp_path), str(tmp_path / "pairs")])
