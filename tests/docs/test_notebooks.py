"""The notebooks run from top to bottom, are kept without outputs, and need only the extras that they name."""

import json
from pathlib import Path

import pytest

from cascadenorm.api.api import methods
from cascadenorm.registry import methods as registry

ROOT = Path(__file__).parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
LONG = {"train_on_own_scans": pytest.mark.slow}  # trains; test_models.py does so on less data


def cells(path, kind):
    return [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == kind]


@pytest.mark.parametrize(
    "path", [pytest.param(path, id=path.stem, marks=LONG.get(path.stem, ())) for path in NOTEBOOKS]
)
def test_it_runs(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(registry, "_methods", methods())  # without what a notebook registers
    names = {}
    for cell in cells(path, "code"):
        assert not cell["outputs"] and cell["execution_count"] is None
        exec(compile("".join(cell["source"]), path.name, "exec"), names)
    written = {"first_steps": "scan.png", "compare_methods": "methods.png", "train_on_own_scans": "mine.safetensors"}
    assert (tmp_path / written[path.stem]).stat().st_size > 1000
    if path.stem == "train_on_own_scans":  # even the tiny training helps
        error = {n: names["cn"].compare(names[n], names["truth"]).normal_error_deg for n in ("noisy", "mine")}
        assert error["mine"] < error["noisy"]


def test_links_lead_to_files():
    for path in NOTEBOOKS:
        text = "".join("".join(cell["source"]) for cell in cells(path, "markdown"))
        for link in text.split("](")[1:]:
            assert (path.parent / link.partition(")")[0]).exists(), link
