"""What the documents say is so."""

import importlib
import json
import re
import shutil
from pathlib import Path

import pytest

from benchmarks.accuracy import results
from cascadenorm.api.api import methods
from cascadenorm.evaluation.harness import DEFAULT_METHODS

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
EXAMPLES = ROOT / "cascadenorm" / "demo_data"


def test_methods_that_are_named_exist():
    for name in DEFAULT_METHODS:
        assert f"`{name}`" in README
        assert name in methods()


@pytest.fixture
def module_table(monkeypatch):
    """The script that writes the table of packages in docs/architecture.md."""
    monkeypatch.syspath_prepend(ROOT / "docs" / "generate")
    return importlib.import_module("module_table")


def test_the_architecture_lists_every_package(module_table):
    page = module_table.PAGE.read_text(encoding="utf-8")
    assert module_table.renewed(page) == page, "run python docs/generate/module_table.py"
    emptied = page.replace("| `cascadenorm/patches/` |", "| `cascadenorm/tiles/` |")
    assert emptied != page and module_table.renewed(emptied) == page


def test_the_page_of_modules_lists_every_module(module_table):
    folders = (ROOT / name for name in ("cascadenorm", "baselines", "data_gen"))
    modules = {path.stem for folder in folders for path in folder.rglob("*.py")}
    page = module_table.module_page()
    listed = set(re.findall(r"\w+", " ".join(re.findall(r"^(?:\| |## )`([^`]+)`", page, re.MULTILINE))))
    assert modules - {"__init__", "__main__"} <= listed


def test_every_module_has_a_summary(module_table):
    for name, path in module_table.modules().items():
        assert len(module_table.summary(path)) > 10, name
    assert module_table.in_order({"a": {"b"}, "b": set(), "c": {"a", "b"}, "d": set()}) == ["b", "d", "a", "c"]


def test_the_table_of_results_is_written_between_its_markers(tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text(f"before\n{results.BEGIN}\nold\n{results.END}\nafter\n", encoding="utf-8")
    results.main([str(EXAMPLES / "scan"), "--readme", str(readme), "--method", "bilateral-normal"])
    text = readme.read_text(encoding="utf-8")
    assert text.startswith(f"before\n{results.BEGIN}\n| pair | noisy | bilateral-normal |\n")
    assert text.endswith(f"|\n{results.END}\nafter\n")
    assert "old" not in text
    row = next(line for line in text.splitlines() if line.startswith("| scan "))
    noisy, denoised = re.findall(r"[\d.]+", row)
    assert f"**{denoised}**" in row
    assert float(denoised) < float(noisy)
    assert results.between_markers(README, "table").count("table\n") == 1


def test_other_programs_are_columns_of_the_table_of_results(tmp_path):
    figures = {"Ev": 0.125, "flip": 0.5}
    runs = {"bnf tuned": {"Ea_deg": 9.75, **figures}, "gnf tuned": {"Ea_deg": 9.25, **figures}}
    runs |= {"l0 default": {"Ea_deg": 0.5, **figures}, "published": {"Ea_deg": 8.25, **figures}}
    assert results.other_results(runs) == {results.TUNED: (9.25, 0.125, 0.5), results.PUBLISHED: (8.25, 0.125, 0.5)}
    readme, reference = tmp_path / "README.md", tmp_path / "results.json"
    readme.write_text(f"{results.BEGIN}\n{results.END}", encoding="utf-8")
    pairs = tmp_path / "pairs"
    for name in ("scan", results.STEERED):
        shutil.copytree(EXAMPLES / "scan", pairs / name)
    reference.write_text(json.dumps({"scan": {"bnf tuned": runs["bnf tuned"]}, results.STEERED: runs}))
    arguments = [str(pairs), "--readme", str(readme), "--method", "bilateral-normal", "--reference", str(reference)]
    results.main(arguments)
    text = readme.read_text(encoding="utf-8").replace("**", "")  # around the best
    lines = [line.strip("| ").split(" | ") for line in text.splitlines()]
    rows = {line[0]: line[1:] for line in lines if len(line) > 2}
    assert rows["scan"][2:] == ["9.75", "–"]
    assert rows[results.STEERED][2:] == ["9.25", "8.25"]
    assert rows["mean angle of normals without kinect_cone, degrees"] == rows["scan"]
    assert "the means are taken without it" in text
