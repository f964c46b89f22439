"""The wheel holds the whole package under one name, and works where the repository is not."""

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import numba
import pytest
from shapes import icosphere, noisy

from cascadenorm.io.interop import save_mesh

ROOT = Path(__file__).parents[2]
SOURCES = ("cascadenorm", "baselines", "data_gen")
FILES = ("pyproject.toml", "README.md", "LICENSE")

BUILD = """
import json, sys
sys.path.insert(0, "release")
import build_backend
kind, folder, settings = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
needed = getattr(build_backend, f"get_requires_for_build_{kind}")(settings)
name = getattr(build_backend, f"build_{kind}")(folder, settings)
print(json.dumps([needed, name]))
"""

LOOK = """
import sys
from pathlib import Path

import cascadenorm, cascadenorm.api.api, cascadenorm.baselines, cascadenorm.data_gen

for package in (cascadenorm, cascadenorm.baselines, cascadenorm.data_gen):
    assert Path(sys.argv[1]) in Path(package.__file__).parents, package.__file__
mesh = cascadenorm.api.api.as_mesh(Path("ball.ply"))
assert (cascadenorm.denoise(mesh, method=sys.argv[2]).vertices != mesh.vertices).any()
assert "torch" not in sys.modules
"""


def run_backend(source, kind, folder, settings, **environment):
    """Call the hooks of the build backend as pip does; return what the build needs, and the name of the wheel."""
    command = [sys.executable, "-c", BUILD, kind, str(folder), json.dumps(settings)]
    done = subprocess.run(command, cwd=source, env=os.environ | environment, check=True, stdout=subprocess.PIPE)
    needed, name = json.loads(done.stdout.splitlines()[-1])
    return needed, name


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder into which the wheel was unpacked; it is built from a copy, so that nothing old gets in."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    for name in (*SOURCES, "release"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in FILES:
        shutil.copy(ROOT / name, source)
    needed, name = run_backend(source, "wheel", folder, {"kernels": "none"})
    assert needed == []
    wheel = folder / name
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


@pytest.mark.parametrize(
    "check", [["twine", "check", "--strict"], ["check_wheel_contents"]], ids=lambda words: words[0]
)
def test_what_checks_uploads_finds_nothing(installed, check):
    (wheel,) = installed.parent.glob("*.whl")
    done = subprocess.run([sys.executable, "-m", *check, wheel], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_it_installs_one_name(installed):
    names = {path.name for path in installed.iterdir() if not path.name.endswith(".dist-info")}
    assert names == {"cascadenorm"}


def test_it_holds_every_module_and_all_data(installed):
    for folder, place in (("cascadenorm", ""), ("baselines", "baselines"), ("data_gen", "data_gen")):
        for path in (ROOT / folder).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                assert (installed / "cascadenorm" / place / path.relative_to(ROOT / folder)).exists(), path


@pytest.mark.parametrize("method", ["bilateral-normal"])
def test_it_denoises_from_another_folder(installed, tmp_path, method):
    save_mesh(tmp_path / "ball.ply", noisy(icosphere(0), 0.2))
    environment = {**os.environ, "PYTHONPATH": str(installed), "NUMBA_DISABLE_JIT": "1"}  # compiling takes longer
    command = [sys.executable, "-c", LOOK, str(installed), method]
    assert subprocess.run(command, cwd=tmp_path, env=environment).returncode == 0


def test_without_kernels_the_wheel_is_universal(installed):
    (wheel,) = installed.parent.glob("*.whl")
    assert wheel.name.endswith("-py3-none-any.whl")
    assert not (installed / "cascadenorm" / "compiled_kernels").exists()


@pytest.fixture
def source(installed, tmp_path):
    """A copy of the sources, without what an earlier build left there."""
    kept = shutil.ignore_patterns("__pycache__", "build", "*.egg-info")
    return shutil.copytree(installed.parent / "source", tmp_path / "source", ignore=kept)


@pytest.mark.parametrize("kind", ["wheel", "editable"])
def test_kernels_that_cannot_be_compiled_do_not_fail_the_installation(source, tmp_path, kind):
    (source / "release" / "compile_kernels.py").write_text("import package_that_does_not_exist")
    needed, name = run_backend(source, kind, tmp_path, {})
    assert {"numba", "numpy", "scipy", "typer"} <= {re.split("[<>=]", text)[0] for text in needed}
    assert name.endswith("-py3-none-any.whl") or kind == "editable"
    assert (tmp_path / name).exists()


DENOISE = """
import sys
from hashlib import sha256
from pathlib import Path
import numba.core.event as events

class Listener(events.Listener):
    def on_start(self, event):
        print(event.data["dispatcher"])

    def on_end(self, event):
        pass

events.register("numba:compile", Listener())
import cascadenorm as cn
from cascadenorm.api.api import as_mesh
whole = as_mesh(Path(cn.__file__).parent / "demo_data" / "part" / "noisy.ply")
for method in cn.methods():
    if method != "fairing":
        found = cn.denoise(whole.vertices, whole.faces[:300], method=method)
        print(method, sha256(found.tobytes()).hexdigest(), file=sys.stderr)
"""


@pytest.mark.slow  # compiles every kernel, twice
@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_with_compiled_kernels_a_first_run_compiles_nothing_and_gives_the_same_bytes(installed, tmp_path):
    (pure,) = installed.parent.glob("*.whl")
    make = [sys.executable, ROOT / "release" / "platform_wheel.py", pure, "--output", tmp_path]
    subprocess.run(make, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    for check in (["twine", "check", "--strict"], ["check_wheel_contents"]):
        subprocess.run([sys.executable, "-m", *check, wheel], check=True)
    environment = os.environ | {"NUMBA_DISABLE_JIT": "0", "PYTHONDONTWRITEBYTECODE": "1"}
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", tmp_path / "venv"], check=True)
    install = [sys.executable, "-m", "pip", "--python", tmp_path / "venv", "install", "--no-deps", wheel]
    subprocess.run(install, check=True)
    (site,) = (tmp_path / "venv").rglob("site-packages")
    runs = []
    for folder in (site, installed):
        environment |= {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(tmp_path / f"kernels{len(runs)}")}
        command = [sys.executable, "-c", DENOISE]
        runs.append(subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True))
    shipped, compiled = runs
    assert shipped.stderr == compiled.stderr
    assert shipped.stdout == ""
    assert len(compiled.stdout.splitlines()) > 100


COMMAND = """
import sys
import numba.core.event as events
from cascadenorm.cli import run

class Listener(events.Listener):
    def on_start(self, event):
        print("compiled", event.data["dispatcher"])

    def on_end(self, event):
        pass

events.register("numba:compile", Listener())
sys.exit(run(sys.argv[1:]))
"""


@pytest.mark.slow  # compiles the kernels of `auto`
@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.parametrize("kind", ["wheel", "editable"])
def test_after_an_installation_by_pip_denoising_compiles_nothing(source, tmp_path, kind):
    cache = {"NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    (tmp_path / "wheels").mkdir()
    _, name = run_backend(source, kind, tmp_path / "wheels", {}, **cache)
    site = source
    if kind == "wheel":
        assert sysconfig.get_platform().replace("-", "_").replace(".", "_") in name
        assert not list((tmp_path / "wheels").glob("*-none-any.whl"))
        site = tmp_path / "site"
        with zipfile.ZipFile(tmp_path / "wheels" / name) as archive:
            archive.extractall(site)
        assert not (tmp_path / "kernels").exists()
    shutil.copy(ROOT / "cascadenorm" / "demo_data" / "part" / "noisy.ply", tmp_path / "mesh.ply")
    environment = os.environ | cache | {"PYTHONPATH": str(site)}
    command = [sys.executable, "-c", COMMAND, "denoise", "mesh.ply"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    assert "compiled" not in done.stdout
    assert (tmp_path / "mesh_denoised.ply").exists()


@pytest.mark.slow  # compiles every kernel
def test_its_demonstration_leaves_pictures_where_it_says(installed, tmp_path):
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    command = [sys.executable, "-m", "cascadenorm", "demo"]
    done = subprocess.run(command, cwd=tmp_path, env=environment, check=True, stdout=subprocess.PIPE, text=True)
    assert "cascadenorm-demo" in done.stdout
    assert (tmp_path / "cascadenorm-demo" / "before-after.png").exists()
