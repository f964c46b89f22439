"""The tests of a module are in a file of its name."""

from collections import Counter
from pathlib import Path

TESTS = Path(__file__).parent
THROUGH_OTHERS = {
    *("display.py", "version.py", "compute/csr.py", "controls/weights.py", "io/libraries.py", "io/shown.py"),
    *("io/ply/header.py", "learned/stage.py", "learned/stage_normals.py", "learned/weights.py"),
    *("learned/training/gate_training.py", "mesh/averages.py", "mesh/topology_kernels.py", "registry/parameters.py"),
    *("baselines/fairing.py", "data_gen/errors.py", "data_gen/shapes/cad.py", "data_gen/shapes/organic.py"),
    "data_gen/shapes/profiles.py",
}
"""Modules that are tested through those that use them."""


def modules() -> set[Path]:
    """Paths of the modules within the package."""
    root = TESTS.parent
    inside = {path.relative_to(root / "cascadenorm") for path in (root / "cascadenorm").rglob("*.py")}
    beside = {path.relative_to(root) for name in ("baselines", "data_gen") for path in (root / name).rglob("*.py")}
    return {path for path in inside | beside if not path.name.startswith("__")}


def has_tests(module: Path) -> bool:
    names = module.stem, f"{module.parent.name}_{module.stem}"
    return any((TESTS / module.parent / f"test_{name}.py").exists() for name in names)


def test_every_module_has_tests_of_its_name_or_is_tested_through_others():
    assert {module.as_posix() for module in modules() if not has_tests(module)} == THROUGH_OTHERS


def test_names_of_test_files_are_unique():
    names = Counter(path.name for path in TESTS.rglob("test_*.py"))
    assert [name for name, count in names.items() if count > 1] == []
