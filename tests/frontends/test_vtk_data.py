"""Data objects of VTK are denoised with their arrays, and blocks with the walls that they share."""

import numpy as np
import pytest
from partitions import walls
from vtk_meshes import BALL, denoised_by, polydata, vertices

import cascadenorm as cn

pytest.importorskip("vtkmodules")
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonDataModel import vtkMultiBlockDataSet, vtkPolyData


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
