"""What the documents say is so."""

import importlib.util
import re
import shlex
from pathlib import Path

import pytest

from cascadenorm import registry
from cascadenorm.api import methods
from cascadenorm.cli import run
from cascadenorm.evaluation.harness import DEFAULT_METHODS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
EXAMPLES = ROOT / "cascadenorm" / "demo_data"


def fenced(text, language):
    """Contents of the fenced blocks of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def commands(text):
    """The cascadenorm commands in the shell blocks, as lists of words without the program."""
    lines = "\n".join(fenced(text, "bash")).replace("&&", "\n").splitlines()
    words = [shlex.split(line, comments=True) for line in lines]
    return [line[1:] for line in words if line and Path(line[0]).name == "cascadenorm"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working directory that holds what the examples speak of."""
    (tmp_path / "scan.ply").write_bytes((EXAMPLES / "scan" / "noisy.ply").read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_python_examples_run(folder):
    (example,) = fenced(README, "python")
    exec(compile(example, "README.md", "exec"), {})
    assert (folder / "scan_denoised.ply").exists()


def test_the_method_in_the_contributing_guide_can_be_registered(monkeypatch):
    monkeypatch.setattr(registry, "_methods", dict(registry._methods))
    (example,) = fenced((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"), "python")
    exec(compile(example, "CONTRIBUTING.md", "exec"), {})
    assert "still" in methods()


@pytest.mark.parametrize("words", commands(README), ids=" ".join)
def test_commands_exist_with_their_options(words, capsys):
    assert run([words[0], "--help"]) == 0
    text = capsys.readouterr().out
    for word in words[1:]:
        if word.startswith("-"):
            assert re.search(rf"(?<![\w-]){word}(?![\w-])", text), f"{words[0]} has no {word}"


def test_methods_that_are_named_exist():
    for name in DEFAULT_METHODS:
        assert f"`{name}`" in README
        assert name in methods()


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md", "docs/architecture.md", "docs/controls.md"])
def test_links_and_files_that_are_named_exist(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    for link in re.findall(r"\]\((?!http)([^)#]+)\)", text):
        assert ((ROOT / name).parent / link).exists(), link
    for script in re.findall(r"python ([\w/]+\.py)", text):
        assert (ROOT / script).exists(), script


def test_the_architecture_names_every_module():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    text = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    words = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]+)`", text))))
    folders = [ROOT / "cascadenorm", ROOT / "baselines", ROOT / "data_gen"]
    modules = {path.stem for folder in folders for path in folder.rglob("*.py")} - {"__init__"}
    assert modules <= words, f"not named: {sorted(modules - words)}"


def test_the_table_of_results_is_written_between_its_markers(tmp_path):
    script = ROOT / "benchmarks" / "results.py"
    spec = importlib.util.spec_from_file_location("results", script)
    results = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(results)
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
