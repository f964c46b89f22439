"""The plugin denoises in ParaView as Python does."""

import os
import shutil
import site
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from partitions import walls
from vtk_meshes import BALL

import cascadenorm as cn
from cascadenorm.io.interop import save_mesh

PLUGIN = Path(cn.__file__).parent / "frontends" / "paraview_plugin.py"


@pytest.fixture(scope="module")
def pvpython(tmp_path_factory):
    """What runs a script in ParaView, with the packages of this environment but VTK, of which ParaView has its own."""
    program = shutil.which("pvpython")
    if program is None:
        pytest.skip("pvpython of ParaView is not installed")
    version = subprocess.run(
        [program, "-c", "import sys; print(sys.version_info[:2])"], stdout=subprocess.PIPE, text=True
    )
    if version.stdout.strip() != str(sys.version_info[:2]):
        pytest.skip(f"the Python of ParaView is {version.stdout}")
    folder = tmp_path_factory.mktemp("environment")
    for path in (path for place in site.getsitepackages() for path in Path(place).iterdir()):
        if not path.name.startswith(("vtk", "pyvista")):
            (folder / path.name).symlink_to(path)
    # ParaView 5.11 imports a name that Python 3.11 lacks; and what is installed as editable is named in a .pth file
    start = f"import inspect, site\ninspect.getargspec = inspect.getfullargspec\nsite.addsitedir({str(folder)!r})\n"
    (folder / "sitecustomize.py").write_text(start)

    def run(script, cwd):
        load = f"from paraview.simple import *\nLoadPlugin({str(PLUGIN)!r}, ns=globals())\n"
        subprocess.run(
            [program, "-c", load + script], cwd=cwd, env={**os.environ, "PYTHONPATH": str(folder)}, check=True
        )

    return run


def test_the_plugin_runs_in_paraview(pvpython, tmp_path):
    save_mesh(tmp_path / "ball.stl", BALL)
    script = """
filter = DenoiseMesh(Input=OpenDataFile("ball.stl"), Method="bilateral-normal", Strength=0.5)
SaveData("out.stl", filter)
"""
    pvpython(script, tmp_path)
    before = cn.read(tmp_path / "ball.stl").mesh
    after = cn.read(tmp_path / "out.stl").mesh
    expected = cn.denoise(before.vertices, before.faces, method="bilateral-normal", strength=0.5)
    np.testing.assert_allclose(after.vertices, expected, atol=1e-5)


def test_a_group_of_meshes_keeps_its_walls_in_paraview(pvpython, tmp_path):
    found = walls("half balls")
    for label in (1, 2):
        save_mesh(tmp_path / f"{label}.stl", found.region(label))
    script = """
import numpy as np
from vtkmodules.util.numpy_support import vtk_to_numpy
given = GroupDatasets(Input=[OpenDataFile("1.stl"), OpenDataFile("2.stl")])
out = DenoiseMesh(Input=given, Method="bilateral-normal")
out.UpdatePipeline()
arrays = {}
for name, data in (("given", servermanager.Fetch(given)), ("out", servermanager.Fetch(out))):
    for i in range(data.GetNumberOfBlocks()):
        arrays[f"{name}{i}"] = vtk_to_numpy(data.GetBlock(i).GetPoints().GetData())
        arrays[f"faces{i}"] = vtk_to_numpy(data.GetBlock(i).GetPolys().GetConnectivityArray()).reshape(-1, 3)
np.savez("out.npz", **arrays)
"""
    pvpython(script, tmp_path)
    with np.load(tmp_path / "out.npz") as arrays:
        parts = [cn.Mesh(arrays[f"given{i}"], arrays[f"faces{i}"]) for i in range(2)]
        for i, expected in enumerate(cn.denoise_regions(parts, method="bilateral-normal")):
            np.testing.assert_allclose(arrays[f"out{i}"], expected.vertices, atol=1e-5)
            assert np.abs(arrays[f"out{i}"] - arrays[f"given{i}"]).max() > 0.01
