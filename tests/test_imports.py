"""Which module may import which, and what is loaded when."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FOLDERS = {"cascadenorm": ROOT / "cascadenorm", "baselines": ROOT / "baselines", "data_gen": ROOT / "data_gen"}

CLASSICAL = {"mesh", "registry", "recover", "volume", "steps"}
MAY_IMPORT = {
    "wording": set(),
    "mesh": {"wording"},
    "steps": set(),
    "registry": {"mesh"},
    "recover": {"mesh", "registry"},
    "volume": {"mesh"},
    "rims": {"mesh"},
    "detail": {"mesh", "baselines"},
    "creases": {"mesh", "registry"},
    "orientation": {"mesh"},
    "nearest": {"mesh"},
    "metrics": {"mesh", "nearest", "volume"},
    "io": {"mesh", "wording"},
    "workers": {"mesh"},
    "data_gen": {"mesh", "workers"},
    "render": {"mesh"},
    "interop": {"mesh", "io"},
    "baselines": CLASSICAL,
    "learned": {*CLASSICAL, "baselines", "data_gen", "workers"},
    "controls": {*CLASSICAL, "orientation", "rims", "creases", "detail"},
    "inspection": {"mesh", "io", "interop", "controls", "volume", "orientation", "nearest"},
    "selection": {"controls", "io", "registry"},
    "api": {*CLASSICAL, "baselines", "learned", "controls", "selection", "interop", "io", "metrics"},
}
"""Parts that are held to a list; the others may import anything but the command line."""


def imported(path: Path) -> set[str]:
    """Parts of the package that a file imports, at its top or inside functions."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name.split(".")[1] for name in names if name.startswith("cascadenorm.")}


def parts() -> dict[str, set[str]]:
    """What each part of the package imports of the others."""
    found: dict[str, set[str]] = {}
    for name, folder in FOLDERS.items():
        for path in sorted(folder.rglob("*.py")):
            inside = path.relative_to(folder).with_suffix("").parts
            part = inside[0] if name == "cascadenorm" else name
            if part not in ("__init__", "__main__"):
                found.setdefault(part, set()).update(imported(path) - {part})
    return found


def test_imports_point_one_way():
    for part, names in parts().items():
        assert "cli" not in names, f"{part} imports the command line"
        if part in MAY_IMPORT:
            extra = names - MAY_IMPORT[part]
            assert not extra, f"{part} imports {', '.join(sorted(extra))}"
    assert set(MAY_IMPORT) <= set(parts())


def loaded_by(code: str) -> set[str]:
    """Top-level packages in memory after some code has run in a fresh interpreter."""
    code += "\nimport sys; print('\\n'.join({name.partition('.')[0] for name in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines())


@pytest.mark.parametrize(
    "code",
    ["import cascadenorm", "from cascadenorm.cli import run; assert run(['--help']) == 0", "import cascadenorm.cli"],
)
def test_help_starts_without_numerical_packages(code):
    assert not loaded_by(code) & {"numpy", "numba", "scipy", "trimesh", "torch", "sklearn", "safetensors"}


def test_denoising_needs_no_training_packages():
    code = """
import numpy, cascadenorm as cn
faces = numpy.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
vertices = numpy.vstack([numpy.eye(3), numpy.zeros(3)])
assert cn.denoise(vertices, faces, method="bilateral-normal").shape == (4, 3)
cn.methods(), cn.evaluate, cn.read"""
    assert not loaded_by(code) & {"torch", "sklearn", "skimage"}
