"""The filter in pipelines of VTK: reader, filter, writer; blocks; properties from the registry; progress and abort."""

import os
import shutil
import site
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from partitions import walls
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm.io.interop import adapter, save_mesh
from cascadenorm.registry.controls import CONTROLS

pytest.importorskip("vtkmodules")
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkPoints, vtkStringOutputWindow
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkMultiBlockDataSet, vtkPolyData
from vtkmodules.vtkFiltersSources import vtkPlaneSource
from vtkmodules.vtkIOPLY import vtkPLYReader, vtkPLYWriter

from cascadenorm.frontends.paraview_xml import declaration
from cascadenorm.frontends.properties import properties
from cascadenorm.frontends.vtk_filter import DenoiseFilter

BALL = noisy(icosphere(2), 0.2)
PLUGIN = Path(cn.__file__).parent / "frontends" / "paraview_plugin.py"


def polydata(mesh):
    data, points, cells = vtkPolyData(), vtkPoints(), vtkCellArray()
    points.SetData(numpy_to_vtk(mesh.vertices, deep=True))
    cells.SetData(3, numpy_to_vtk(mesh.faces.astype(np.int64).ravel(), deep=True))
    data.SetPoints(points)
    data.SetPolys(cells)
    return data


def vertices(data):
    return adapter(data).arrays(data)[0]


def denoised_by(data, **values):
    """Run the filter with properties set to values."""
    filter = DenoiseFilter()
    for name, value in {"Method": "bilateral-normal", **values}.items():
        getattr(filter, f"Set{name}")(value)
    filter.SetInputData(data)
    filter.Update()
    return filter


@pytest.fixture
def window():
    """What VTK has to say, as text."""
    before, window = vtkOutputWindow.GetInstance(), vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    yield window
    vtkOutputWindow.SetInstance(before)


def test_a_pipeline_from_a_file_to_a_file(tmp_path):
    save_mesh(tmp_path / "ball.ply", BALL)
    reader, filter, writer = vtkPLYReader(), DenoiseFilter(), vtkPLYWriter()
    reader.SetFileName(str(tmp_path / "ball.ply"))
    filter.SetInputConnection(reader.GetOutputPort())
    filter.SetMethod("bilateral-normal")
    filter.SetStrength(0.5)
    writer.SetInputConnection(filter.GetOutputPort())
    writer.SetFileName(str(tmp_path / "out.ply"))
    writer.Write()
    single = BALL.vertices.astype(np.float32)  # which is what VTK reads
    expected = cn.denoise(single, BALL.faces, method="bilateral-normal", strength=0.5)
    np.testing.assert_array_equal(cn.read(tmp_path / "out.ply").mesh.vertices, expected)

    filter.SetStrength(0)  # a property that changes has the pipeline run again
    writer.Write()
    np.testing.assert_array_equal(cn.read(tmp_path / "out.ply").mesh.vertices, single)


def test_a_polydata_comes_back_with_its_arrays_and_new_normals():
    data = polydata(BALL)
    heat, stored = numpy_to_vtk(np.arange(162.0), deep=True), numpy_to_vtk(-BALL.vertex_normals, deep=True)
    heat.SetName("heat")
    stored.SetName("shading")
    data.GetPointData().AddArray(heat)
    data.GetPointData().SetNormals(stored)
    out = cn.denoise(data, method="bilateral-normal")
    expected = cn.denoise(BALL, method="bilateral-normal")
    assert isinstance(out, vtkPolyData) and vertices(data).tobytes() == BALL.vertices.tobytes()
    assert vertices(out).tobytes() == expected.vertices.tobytes()
    np.testing.assert_array_equal(vtk_to_numpy(out.GetPointData().GetArray("heat")), np.arange(162.0))
    np.testing.assert_allclose(vtk_to_numpy(out.GetPointData().GetNormals()), -expected.vertex_normals, atol=1e-12)
    np.testing.assert_array_equal(vtk_to_numpy(data.GetPointData().GetNormals()), -BALL.vertex_normals)


def test_names_of_arrays_and_text_set_controls():
    data, right = polydata(BALL), BALL.vertices[:, 0] > 0
    weight = numpy_to_vtk(right.astype(float), deep=True)
    weight.SetName("weight")
    data.GetPointData().AddArray(weight)
    out = denoised_by(data, Mask="weight", MaxDisplacement="0.2 edges", Creases="60", Volume="keep").GetOutput()
    expected = cn.denoise(
        BALL, method="bilateral-normal", mask=right, max_displacement="0.2 edges", creases=60, volume="keep"
    )
    assert vertices(out).tobytes() == expected.vertices.tobytes() != BALL.vertices.tobytes()
    assert (
        vertices(denoised_by(data, Mask="").GetOutput()).tobytes() == vertices(denoised_by(data).GetOutput()).tobytes()
    )


def test_parameters_belong_to_their_method():
    filter = denoised_by(polydata(BALL), BilateralNormalIterations=3, TaubinIterations="7")
    expected = cn.denoise(BALL, method="bilateral-normal", iterations=3)
    assert vertices(filter.GetOutput()).tobytes() == expected.vertices.tobytes()
    assert filter.GetTaubinIterations() == 7
    with pytest.raises(cn.ParameterError, match="iterations is -1"):
        filter.SetTaubinIterations(-1)
    with pytest.raises(cn.ParameterError, match="no method 'magic'"):
        filter.SetMethod("magic")


def test_blocks_keep_their_walls_shared():
    found = walls("half balls")
    parts = [found.region(label) for label in (1, 2)]
    blocks, inner = vtkMultiBlockDataSet(), vtkMultiBlockDataSet()
    inner.SetBlock(0, polydata(parts[1]))
    blocks.SetBlock(0, polydata(parts[0]))
    blocks.SetBlock(2, inner)  # and none at 1
    blocks.GetMetaData(0).Set(vtkMultiBlockDataSet.NAME(), "left")
    out = denoised_by(blocks).GetOutput()
    expected = cn.denoise_regions(parts, method="bilateral-normal")
    assert isinstance(out, vtkMultiBlockDataSet) and out.GetBlock(1) is None
    assert out.GetMetaData(0).Get(vtkMultiBlockDataSet.NAME()) == "left"
    assert vertices(out.GetBlock(0)).tobytes() == expected[0].vertices.tobytes() != parts[0].vertices.tobytes()
    assert vertices(out.GetBlock(2).GetBlock(0)).tobytes() == expected[1].vertices.tobytes()


def test_blocks_may_have_vertices_that_are_isolated(window):
    blocks, broken = vtkMultiBlockDataSet(), polydata(BALL.moved(BALL.vertices))
    vtk_to_numpy(broken.GetPoints().GetData())[5] = np.nan
    blocks.SetBlock(0, broken)
    denoised_by(blocks)
    assert "SetOnBad('isolate')" in window.GetOutput()
    out = vertices(denoised_by(blocks, OnBad="isolate").GetOutput().GetBlock(0))
    assert np.isnan(out[5]).all() and np.isfinite(np.delete(out, 5, axis=0)).all()


def test_progress_is_reported_and_an_observer_can_end_the_work():
    shares = []
    filter = DenoiseFilter()
    filter.SetMethod("bilateral-normal")
    filter.SetInputData(polydata(BALL))
    filter.AddObserver("ProgressEvent", lambda *_: shares.append(filter.GetProgress()))
    filter.Update()
    assert shares == sorted(shares) and len(set(shares)) > 3 and shares[-1] == 1
    assert filter.GetOutput().GetNumberOfPoints() == 162

    seen = []
    filter.AddObserver("ProgressEvent", lambda *_: (seen.append(1), filter.SetAbortExecute(1)))
    filter.Modified()
    filter.Update()
    assert len(seen) < len(shares) and filter.GetOutput().GetNumberOfPoints() == 0


def test_errors_are_told_by_vtk_with_what_to_do(window):
    plane = vtkPlaneSource()
    plane.Update()
    filter = denoised_by(plane.GetOutput())
    assert (
        "cascadenorm: the vtkPolyData has cells that are not triangles: apply vtkTriangleFilter" in window.GetOutput()
    )
    assert isinstance(filter.error, cn.MeshError)
    plane.GetOutput().SetPolys(vtkCellArray())
    plane.GetOutput().SetVerts(polydata(BALL).GetPolys())
    denoised_by(plane.GetOutput())
    assert "cascadenorm: the mesh has no faces: reconstruct a surface from the points first" in window.GetOutput()
    broken = polydata(BALL.moved(BALL.vertices))
    vtk_to_numpy(broken.GetPoints().GetData())[5] = np.nan
    denoised_by(broken)
    assert "SetOnBad('isolate')" in window.GetOutput()
    filter.SetInputData(polydata(BALL))
    filter.Update()
    assert filter.error is None and filter.GetOutput().GetNumberOfPoints() == 162


def test_every_control_and_parameter_is_a_property_of_filter_and_plugin():
    names = {property.name for property in properties()}
    assert len(names) == len(list(properties()))
    assert {"Strength", "KeepDetail", "MaxDisplacement", "TaubinIterations", "AutoModel"} <= names
    assert len(names) == sum(not control.about.hidden for control in CONTROLS.values()) + sum(
        len(method.given_by_name) for method in cn.methods().values()
    )
    elements = ElementTree.fromstring(f"<Proxy>{declaration()}</Proxy>")
    assert {element.get("name") for element in elements} == {"Input", "Method", *names}
    filter = DenoiseFilter()
    methods = {value.get("value") for value in elements.find("*[@name='Method']").iter("String")}
    assert methods == set(cn.methods())
    for element in elements:
        if element.get("name") != "Input":
            before = filter.GetMTime()
            getattr(filter, element.get("command"))(element.get("default_values"))  # the default is admitted
            assert filter.GetMTime() == before  # and changes nothing
        for decorator in element.iter("PropertyWidgetDecorator"):
            assert decorator.get("value") in methods


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
