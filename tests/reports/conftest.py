"""A folder with meshes for the tests of reports."""

import pytest
from report_contents import CLEAN, ROUGH

from cascadenorm.io.interop import save_mesh


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_mesh(tmp_path / "rough.ply", ROUGH)
    save_mesh(tmp_path / "true.ply", CLEAN)
    return tmp_path
