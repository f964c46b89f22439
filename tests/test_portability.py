"""The command line writes the same bytes whatever the locale, the encoding of texts and the home of its user are."""

import ast
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from shapes import icosphere, noisy

from cascadenorm.interop import save_mesh
from cascadenorm.mesh import Mesh

ROOT = Path(__file__).parents[1]
PROGRAM = """
import locale, sys
locale.setlocale(locale.LC_ALL, "")  # as programs do that embed Python
assert locale.localeconv()["decimal_point"] == sys.argv[1]
from cascadenorm.cli import main
main(sys.argv[2:])
"""
NAMES = ("scan.ply", "größe.obj", "two words.off", "☃.stl")
OPTIONS = ("--method", "laplacian", "--strength", "0.5", "--max-displacement", "0.25 edges", "--json")
GERMAN = "de_DE.UTF-8"


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("meshes")
    ball = noisy(icosphere(2), 0.2)
    for number, name in enumerate(NAMES):
        save_mesh(folder / name, Mesh(ball.vertices + 3 * number, ball.faces))
    return folder


def outputs(meshes, folder, point=".", **variables):
    """Denoise the meshes in a process with other environment variables; what was written and reported."""
    dropped = {"LANG", "PYTHONUTF8", *(name for name in os.environ if name.startswith("LC_"))}
    environment = {name: value for name, value in os.environ.items() if name not in dropped} | variables
    command = [sys.executable, "-c", PROGRAM, point, "denoise-regions", *NAMES, *OPTIONS, "-o", str(folder / "out")]
    done = subprocess.run(command, cwd=meshes, env=environment, capture_output=True)
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    files = json.loads(done.stdout)["files"]
    return [(folder / "out" / name).read_bytes() for name in NAMES], [file["mean_displacement"] for file in files]


@pytest.fixture(scope="module")
def usual(meshes, tmp_path_factory):
    return outputs(meshes, tmp_path_factory.mktemp("usual"), PYTHONUTF8="1")


def test_texts_are_not_in_the_encoding_of_the_locale(meshes, usual, tmp_path):
    assert outputs(meshes, tmp_path, PYTHONUTF8="0", LC_ALL="C") == usual


def test_numbers_have_points_where_the_locale_has_commas(meshes, usual, tmp_path):
    if shutil.which("localedef"):
        make = ["localedef", "--no-archive", "-i", "de_DE", "-f", "UTF-8", str(tmp_path / GERMAN)]
        subprocess.run(make, capture_output=True)
    if not (tmp_path / GERMAN).exists():
        pytest.skip("there is no localedef that makes a German locale")
    assert outputs(meshes, tmp_path, ",", LOCPATH=str(tmp_path), LC_ALL=GERMAN, PYTHONUTF8="0") == usual


def test_the_home_need_not_be_one_that_can_be_written(meshes, usual, tmp_path):
    assert outputs(meshes, tmp_path, HOME=os.devnull, XDG_CACHE_HOME=os.devnull) == usual


def test_the_home_may_have_any_name(meshes, usual, tmp_path):
    home = tmp_path / "Jürgen Müller's home ☃"
    home.mkdir()
    kernels = home / "kernels"
    variables = {"HOME": str(home), "NUMBA_CACHE_DIR": str(kernels)}
    assert outputs(meshes, home, **variables) == usual
    assert kernels.is_dir() or os.environ.get("NUMBA_DISABLE_JIT") == "1"
    assert outputs(meshes, tmp_path, **variables) == usual  # with the kernels that lie there now


@pytest.mark.parametrize("folder", ["cascadenorm", "baselines", "data_gen"])
def test_texts_are_read_and_written_as_utf_8(folder):
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", "") in ("read_text", "write_text"):
                assert "encoding" in {word.arg for word in node.keywords}, f"{path}:{node.lineno}"
