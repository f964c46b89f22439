"""Every registered method that needs no region."""

from functools import cache

import pytest
from shapes import grid

import cascadenorm as cn


@cache
def refusal(method: str) -> str:
    """Why a method does not run without further parameters, if it does not."""
    try:
        cn.denoise(grid(2, 2), method=method)
    except cn.ParameterError as error:
        return str(error)
    return ""


@pytest.fixture(params=sorted(cn.methods()))
def name(request) -> str:
    if error := refusal(request.param):
        pytest.skip(f"{request.param} cannot run here: {error}")
    return request.param
