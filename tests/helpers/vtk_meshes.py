"""Meshes as datasets of VTK, and the filter that denoises them."""

import numpy as np
import pytest
from shapes import icosphere, noisy

from cascadenorm.io.interop import adapter

pytest.importorskip("vtkmodules")
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

from cascadenorm.frontends.vtk_filter import DenoiseFilter

BALL = noisy(icosphere(2), 0.2)


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
