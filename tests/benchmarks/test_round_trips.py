"""The record behind the table of docs/other-programs.md is what survives of meshes of other libraries."""

import pytest

from benchmarks import results
from benchmarks.robustness import round_trips as script


@pytest.mark.parametrize("library", ["trimesh", "pyvista", "open3d", "meshio", "arrays"])
def test_the_record_is_true(library):
    if library not in script.installed():
        pytest.skip(f"{library} is not installed")
    found = [list(names) for names in script.row(script.LIBRARIES[library]())]
    assert found == results.read("round-trips")[library]
