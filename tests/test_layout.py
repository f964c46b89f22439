"""The tests of a module are in a file of its name."""

from collections import Counter
from pathlib import Path

from modules import MODULES

TESTS = Path(__file__).parent
THROUGH_OTHERS = {
    *("display", "version", "compute.csr", "controls.weights", "io.libraries", "io.shown", "io.ply.header"),
    *("learned.stage", "learned.stage_normals", "learned.weights", "learned.training.gate_training"),
    *("mesh.averages", "mesh.topology_kernels", "registry.parameters", "baselines.fairing", "data_gen.errors"),
    *("data_gen.shapes.cad", "data_gen.shapes.organic", "data_gen.shapes.profiles"),
}
"""Modules that are tested through those that use them."""


def has_tests(module: str) -> bool:
    *folders, name = module.split(".")
    names = name, "_".join([*folders[-1:], name])
    return any(TESTS.joinpath(*folders, f"test_{name}.py").exists() for name in names)


def test_every_module_has_tests_of_its_name_or_is_tested_through_others():
    modules = (module for module, path in MODULES.items() if path.name != "__init__.py")
    assert {module for module in modules if not has_tests(module)} == THROUGH_OTHERS


def test_names_of_test_files_are_unique():
    names = Counter(path.name for path in TESTS.rglob("test_*.py"))
    assert [name for name, count in names.items() if count > 1] == []
