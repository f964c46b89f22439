"""What the documents say is so."""

import re
from pathlib import Path

from cascadenorm.api.api import methods
from cascadenorm.evaluation.harness import DEFAULT_METHODS

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_methods_that_are_named_exist():
    for name in DEFAULT_METHODS:
        assert f"`{name}`" in README
        assert name in methods()


def test_the_architecture_lists_every_module(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "generate")
    import module_table

    page = module_table.PAGE.read_text(encoding="utf-8")
    assert module_table.renewed(page) == page, "run python docs/generate/module_table.py"
    emptied = page.replace("| `halo` |", "| `hallo` |")
    assert emptied != page and module_table.renewed(emptied) == page
    modules = {
        path.stem for folder in ("cascadenorm", "baselines", "data_gen") for path in (ROOT / folder).rglob("*.py")
    }
    listed = set(re.findall(r"\w+", " ".join(re.findall(r"^\| \**`([^`]+)`", page, re.MULTILINE))))
    assert modules - {"__init__", "__main__"} <= listed


def test_the_table_of_modules_has_a_sentence_for_each(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "generate")
    import module_table

    for name, path in module_table.modules().items():
        assert len(module_table.summary(path)) > 10, name
    assert module_table.in_order({"a": {"b"}, "b": set(), "c": {"a", "b"}, "d": set()}) == ["b", "d", "a", "c"]
