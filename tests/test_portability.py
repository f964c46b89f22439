"""The command line writes the same bytes whatever the locale, the encoding of texts and the home of its user are.

And nothing needs what other systems lack: processes that are forked, calls of POSIX, indices of 64 bits.
"""

import ast
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.cli import run
from cascadenorm.io.interop import save_mesh
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
FOLDERS = ("cascadenorm", "baselines", "data_gen")
OF_POSIX = (
    "fork forkpty register_at_fork sched_getaffinity sched_setaffinity sysconf getuid geteuid getgid uname statvfs "
    "chown fchown fchmod pread pwrite getloadavg killpg setsid mkfifo nice posix_fallocate"
)
"""Functions of os that Windows lacks."""
WITHOUT = f"""
import os, numba, numpy, scipy.sparse.linalg  # with what they themselves take from os
for name in {OF_POSIX.split()}:
    if hasattr(os, name):
        delattr(os, name)
"""


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("meshes")
    ball = noisy(icosphere(2), 0.2)
    for number, name in enumerate(NAMES):
        save_mesh(folder / name, Mesh(ball.vertices + 3 * number, ball.faces))
    return folder


def words(folder):
    """The command that denoises the meshes of the working directory into a folder."""
    return ["denoise-regions", *NAMES, *OPTIONS, "-o", str(folder / "out")]


def results(folder, printed):
    """What was written and reported."""
    files = json.loads(printed)["files"]
    return [(folder / "out" / name).read_bytes() for name in NAMES], [file["mean_displacement"] for file in files]


def outputs(meshes, folder, point=".", first="", **variables):
    """Denoise the meshes in a process with other environment variables; what was written and reported.

    Parameters
    ----------
    point : that stands in decimal numbers of the locale
    first : Python that the process runs first
    """
    dropped = {"LANG", "PYTHONUTF8", *(name for name in os.environ if name.startswith("LC_"))}
    environment = {name: value for name, value in os.environ.items() if name not in dropped} | variables
    command = [sys.executable, "-c", first + PROGRAM, point, *words(folder)]
    done = subprocess.run(command, cwd=meshes, env=environment, capture_output=True)
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    return results(folder, done.stdout)


@pytest.fixture
def usual(meshes, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(meshes)
    assert run(words(tmp_path / "usual")) == 0
    return results(tmp_path / "usual", capsys.readouterr().out)


@pytest.fixture
def home(tmp_path):
    """A home of a user with a name of many characters."""
    made = tmp_path / "Jürgen Müller's home ☃"
    made.mkdir()
    return made


def test_texts_and_the_home_are_not_in_the_encoding_of_the_locale(meshes, usual, home):
    assert outputs(meshes, home, PYTHONUTF8="0", LC_ALL="C", HOME=str(home)) == usual


def test_numbers_have_points_where_the_locale_has_commas(meshes, usual, tmp_path):
    if shutil.which("localedef"):
        make = ["localedef", "--no-archive", "-i", "de_DE", "-f", "UTF-8", str(tmp_path / GERMAN)]
        subprocess.run(make, capture_output=True)
    if not (tmp_path / GERMAN).exists():
        pytest.skip("there is no localedef that makes a German locale")
    assert outputs(meshes, tmp_path, ",", LOCPATH=str(tmp_path), LC_ALL=GERMAN, PYTHONUTF8="0") == usual


@pytest.mark.slow  # compiles all that the command needs; test_kernel_cache.py keeps one kernel in such a folder
def test_kernels_may_be_kept_in_a_home_with_any_name(meshes, usual, home, tmp_path):
    kernels = home / "kernels"
    variables = {"HOME": str(home), "NUMBA_CACHE_DIR": str(kernels)}
    assert outputs(meshes, home, **variables) == usual
    assert kernels.is_dir() or os.environ.get("NUMBA_DISABLE_JIT") == "1"
    assert outputs(meshes, tmp_path, **variables) == usual  # with the kernels that lie there now


def test_neither_a_home_that_can_be_written_nor_calls_that_windows_lacks_are_needed(meshes, usual, tmp_path):
    assert outputs(meshes, tmp_path, first=WITHOUT, HOME=os.devnull, XDG_CACHE_HOME=os.devnull) == usual


def test_processes_are_spawned_not_forked():
    started = set()
    for path in (path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                name = ast.unparse(node.func).rpartition(".")[2]
                arguments = [ast.unparse(one) for one in (*node.args, *(word.value for word in node.keywords))]
                assert name not in ("fork", "forkpty"), f"{path}:{node.lineno}"
                if name in ("get_context", "set_start_method"):
                    assert arguments == ["'spawn'"], f"{path}:{node.lineno}"
                    started.add(path.name)
                if name in ("Process", "Pool", "ProcessPoolExecutor"):
                    call = ast.unparse(node)
                    assert call.startswith("context.") or "get_context('spawn')" in call, f"{path}:{node.lineno}"
    assert started >= {"process_map.py", "worker_processes.py"}


@pytest.mark.parametrize("kind", [np.int32, np.uint32, np.int64])
def test_indices_of_32_bits_are_enough(kind):
    side = 260  # more than 2**16 vertices, so that products of two indices do not fit
    i, j = np.divmod(np.arange((side - 1) ** 2), side - 1)
    corner = i * side + j
    squares = np.stack([corner, corner + 1, corner + side, corner + 1, corner + side + 1, corner + side], axis=1)
    faces = squares.reshape(-1, 3)
    x, y = np.divmod(np.arange(side**2), side)
    vertices = np.stack([x, y, np.sin(7.0 * x) * np.sin(5.0 * y) / 4], axis=1)
    mesh = cn.Mesh(vertices, faces.astype(kind))
    assert len(mesh.topology.edges) == len(mesh.vertices) + len(faces) - 1  # of a disc, by Euler's formula
    out = cn.denoise(vertices, faces.astype(kind), method="laplacian", iterations=1)
    assert out.tobytes() == cn.denoise(vertices, faces, method="laplacian", iterations=1).tobytes()
    assert np.abs(out - vertices).max() > 0.01


def test_a_file_may_be_spelled_in_either_case_where_it_is_the_same(tmp_path):
    save_mesh(tmp_path / "scan.ply", noisy(icosphere(1), 0.2))
    other = tmp_path / "SCAN.PLY"
    if not other.exists():
        other.symlink_to(tmp_path / "scan.ply")  # what a folder does that ignores case
    assert cn.read(other).mesh.vertices.tobytes() == cn.read(tmp_path / "scan.ply").mesh.vertices.tobytes()
    before = (tmp_path / "scan.ply").read_bytes()
    with pytest.raises(cn.OutputError, match="exists already"):
        cn.denoise_file(tmp_path / "scan.ply", other)
    assert (tmp_path / "scan.ply").read_bytes() == before


@pytest.mark.parametrize("folder", FOLDERS)
def test_texts_are_read_and_written_as_utf_8(folder):
    for path in (ROOT / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", "") in ("read_text", "write_text"):
                assert "encoding" in {word.arg for word in node.keywords}, f"{path}:{node.lineno}"
