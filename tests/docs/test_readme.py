"""What the documents say is so."""

import importlib
import re
from pathlib import Path

import pytest

from cascadenorm.api.api import methods
from cascadenorm.evaluation.harness import DEFAULT_METHODS

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


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
    emptied = page.replace("| `cascadenorm/controls/` |", "| `cascadenorm/tiles/` |")
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
