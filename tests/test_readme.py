"""What the documents say is so."""

import importlib.util
import re
from pathlib import Path

from cascadenorm.api import methods
from cascadenorm.evaluation.harness import DEFAULT_METHODS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
EXAMPLES = ROOT / "cascadenorm" / "demo_data"


def test_methods_that_are_named_exist():
    for name in DEFAULT_METHODS:
        assert f"`{name}`" in README
        assert name in methods()


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
