"""Properties of a filter belong to the method that has them."""

import pytest
from vtk_meshes import BALL, denoised_by, polydata, vertices

import cascadenorm as cn


def test_parameters_belong_to_their_method():
    filter = denoised_by(polydata(BALL), BilateralNormalIterations=3, TaubinIterations="7")
    expected = cn.denoise(BALL, method="bilateral-normal", iterations=3)
    assert vertices(filter.GetOutput()).tobytes() == expected.vertices.tobytes()
    assert filter.GetTaubinIterations() == 7
    with pytest.raises(cn.ParameterError, match="iterations is -1"):
        filter.SetTaubinIterations(-1)
    with pytest.raises(cn.ParameterError, match="no method 'magic'"):
        filter.SetMethod("magic")
