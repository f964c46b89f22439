"""The table of docs/other-programs.md tells what of meshes of other libraries survives."""

import pytest

from benchmarks.robustness import round_trips as script


@pytest.mark.parametrize("library", ["trimesh", "pyvista", "open3d", "meshio", "arrays"])
def test_the_table_is_true(library):
    if library not in script.installed():
        pytest.skip(f"{library} is not installed")
    (line,) = script.table([library])
    assert line in script.PAGE.read_text(encoding="utf-8").splitlines()
