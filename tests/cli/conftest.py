"""Folders with meshes for the tests of commands."""

from pathlib import Path

import pytest
from commands import CLEAN, ROUGH
from shapes import grid, noisy

from cascadenorm.io.interop import save_mesh


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    save_mesh(tmp_path / "ball.ply", ROUGH)
    save_mesh(tmp_path / "true.ply", CLEAN)
    return tmp_path


@pytest.fixture
def pairs(tmp_path) -> Path:
    for name, clean in {"ball": CLEAN, "sheet": grid(6, 6)}.items():
        (tmp_path / "pairs" / name).mkdir(parents=True)
        save_mesh(tmp_path / "pairs" / name / "noisy.ply", noisy(clean, 0.2))
        save_mesh(tmp_path / "pairs" / name / "clean.ply", clean)
    return tmp_path / "pairs"
