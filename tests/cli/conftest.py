"""A folder with meshes for the tests of commands."""

from pathlib import Path

import pytest
from commands import CLEAN, ROUGH

from cascadenorm.io.interop import save_mesh


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    save_mesh(tmp_path / "ball.ply", ROUGH)
    save_mesh(tmp_path / "true.ply", CLEAN)
    return tmp_path
