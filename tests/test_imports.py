"""Which module may import which, and what is loaded when."""

import ast
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from modules import MODULES
from shapes import icosphere, noisy

from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh

MAY_IMPORT = {
    "version": "",
    "errors": "",
    "display": "",
    "compute": "",
    "execution": "version errors compute",
    "mesh": "errors display compute",
    "registry": "errors mesh",
    "io": "errors mesh",
    "detection": "mesh",
    "geometry": "errors execution mesh registry detection",
    "data_gen": "execution mesh detection",
    "baselines": "compute execution mesh registry geometry",
    "learned": "errors compute execution mesh registry detection geometry data_gen baselines",
    "controls": "errors mesh registry detection geometry baselines",
    "render": "errors mesh io geometry",
    "api": "errors compute execution mesh registry io detection geometry data_gen baselines learned controls",
    "batch": "version errors execution mesh registry io learned api",
    "evaluation": "version errors execution mesh registry io geometry data_gen api",
    "frontends": "errors execution mesh registry io geometry api",
    "reports": "version errors execution mesh registry io geometry render api evaluation",
    "studio": "errors compute execution mesh registry io api reports",
    "cli": "version errors compute execution mesh registry io geometry learned render api batch evaluation reports "
    "studio",
}
"""What the modules of a room may import besides one another, in an order in which each room has only earlier ones."""


def top_of(name: str) -> str:
    """The first part of a dotted name."""
    return name.partition(".")[0]


@cache
def imported(path: Path) -> set[str]:
    """Modules that a file imports, at its top or inside functions, by name or by `import_module`; "" is the package."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Call) and ast.unparse(node.func).rpartition(".")[2] in (
            "import_module",
            "__import__",
        ):
            (name,) = node.args
            assert isinstance(name, ast.Constant), f"{path}: what is imported stands there as text"
            names.add(name.value)
    inside = {name.removeprefix("cascadenorm").removeprefix(".") for name in names if top_of(name) == "cascadenorm"}
    return {name if name in MODULES else name.rpartition(".")[0] for name in inside}


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("import cascadenorm", {""}),
        ("import cascadenorm as cn", {""}),
        ("from cascadenorm import denoise, errors", {"", "errors"}),
        ("import cascadenorm.mesh.frame", {"mesh.frame"}),
        ("from cascadenorm.mesh import Mesh, frame", {"mesh", "mesh.frame"}),
        ("def late():\n    from cascadenorm.io import read", {"io"}),
        ("importlib.import_module('cascadenorm.reports.notebook')", {"reports.notebook"}),
        ("import numpy, cascadenorm_other", set()),
    ],
)
def test_every_way_to_import_is_seen(tmp_path, line, found):
    (tmp_path / "module.py").write_text(line)
    assert imported(tmp_path / "module.py") == found


@pytest.mark.parametrize("module", MODULES)
def test_imports_point_one_way(module):
    room = top_of(module)
    assert room in MAY_IMPORT, f"MAY_IMPORT has no rule for {room}"
    extra = {other for other in imported(MODULES[module]) if top_of(other) not in {room, *MAY_IMPORT[room].split()}}
    assert not extra, f"{module} imports {', '.join(sorted(name or 'the whole package' for name in extra))}"


def test_a_room_imports_only_rooms_before_it():
    rooms = list(MAY_IMPORT)
    assert {top_of(module) for module in MODULES} == set(rooms)
    for place, room in enumerate(rooms):
        assert set(MAY_IMPORT[room].split()) <= set(rooms[:place]), room


def test_no_rule_allows_more_than_there_is():
    there = {(top_of(module), top_of(other)) for module, path in MODULES.items() for other in imported(path)}
    allowed = {(room, other) for room, others in MAY_IMPORT.items() for other in others.split()}
    assert not allowed - there


def test_no_constant_of_the_baselines_is_taken_by_what_surrounds_them():
    """A constant of a method can then be changed with that method alone in view."""
    for module, path in MODULES.items():
        if top_of(module) == "baselines":
            continue
        tree = ast.parse(path.read_text(encoding="utf-8"))
        imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        taken = {(node.module, alias.name) for node in imports for alias in node.names}
        baselines = {name for origin, name in taken if origin == "cascadenorm.baselines"}
        found = {name for origin, name in taken if str(origin).startswith("cascadenorm.baselines.") and name.isupper()}
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and ast.unparse(node.value).rpartition(".")[2] in baselines:
                found |= {node.attr} if node.attr.isupper() else set()
        assert not found, f"{module} takes {', '.join(sorted(found))} of the baselines"


def test_no_modules_import_each_other_in_a_circle():
    graph = {module: imported(path) - {module} for module, path in MODULES.items()}
    circle = []
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        circle = error.args[1]
    assert not circle, " imports ".join(reversed(circle))


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


def test_the_studio_serves_its_page_without_numerical_packages():
    code = """
from pathlib import Path
from cascadenorm.studio.application import Application
from cascadenorm.studio.server import Uploads
from cascadenorm.studio.session import Session
assert len(Application(Session(), Uploads(Path(), most=0)).routes()) > 10"""
    assert not loaded_by(code) & {"numpy", "numba", "scipy", "trimesh", "torch", "safetensors"}


UNNEEDED = {
    "auto": {"scipy.sparse", "scipy.spatial"},
    "bilateral-normal": {"scipy.sparse", "scipy.spatial"},
    "taubin": set(),
}
"""What a method does without; those that need most come last, since one process runs them all."""


def test_the_command_that_denoises_imports_only_what_the_method_needs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_mesh(tmp_path / "noisy.ply", noisy(icosphere(1), 0.1))
    code = f"""
import sys
from cascadenorm.cli import run
for method in {list(UNNEEDED)}:
    assert run(["denoise", "noisy.ply", "-o", f"{{method}}.ply", "--method", method]) == 0
    print("in memory:", *sys.modules)"""
    for method in UNNEEDED:  # what a process compiles itself needs more modules
        assert run(["denoise", "noisy.ply", "-o", f"{method}.ply", "--method", method]) == 0
        (tmp_path / f"{method}.ply").unlink()
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    # the last two belong to what numba compiles array expressions from, which takes a fifth of a second to load
    never = {
        "cascadenorm.data_gen",
        "matplotlib",
        "scipy.interpolate",
        "scipy.optimize",
        "scipy.linalg",
        "numba.np.arraymath",
    }
    lines = [line for line in done.stdout.splitlines() if line.startswith("in memory: ")]
    for (method, unneeded), line in zip(UNNEEDED.items(), lines, strict=True):
        loaded = set(line.split())
        assert "cascadenorm.api.opened_files" in loaded
        assert not (never | unneeded) & loaded, method


def test_denoising_needs_no_training_packages():
    code = """
import numpy, cascadenorm as cn
faces = numpy.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
vertices = numpy.vstack([numpy.eye(3), numpy.zeros(3)])
assert cn.denoise(vertices, faces, method="bilateral-normal").shape == (4, 3)
cn.methods(), cn.evaluate, cn.read"""
    assert not loaded_by(code) & {"torch", "sklearn", "skimage"}
