"""The table of docs/other-programs.md tells what of meshes of other libraries survives."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def script():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "benchmarks")
        yield importlib.import_module("round_trips")


@pytest.mark.parametrize("library", ["trimesh", "pyvista", "open3d", "meshio", "arrays"])
def test_the_table_is_true(script, library):
    if library not in script.installed():
        pytest.skip(f"{library} is not installed")
    (line,) = script.table([library])
    assert line in script.PAGE.read_text(encoding="utf-8").splitlines()
