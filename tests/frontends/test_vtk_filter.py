"""The filter in pipelines of VTK: reader, filter, writer; progress, abort and errors."""

import numpy as np
import pytest
from vtk_meshes import BALL, denoised_by, polydata

import cascadenorm as cn
from cascadenorm.io.interop import save_mesh

pytest.importorskip("vtkmodules")
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkCellArray
from vtkmodules.vtkFiltersSources import vtkPlaneSource
from vtkmodules.vtkIOPLY import vtkPLYReader, vtkPLYWriter

from cascadenorm.frontends.vtk_filter import DenoiseFilter


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
