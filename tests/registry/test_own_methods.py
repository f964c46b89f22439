"""Methods that are registered from outside the package."""

from typing import Annotated

import pytest
from shapes import icosphere

import cascadenorm as cn
from cascadenorm.errors import DenoiseError, ParameterError
from cascadenorm.registry import Parameter, method
from cascadenorm.registry import methods as registry


@pytest.fixture
def registered(monkeypatch):
    """A function that registers another one as the method `mine` during a test."""
    monkeypatch.setattr(registry, "_methods", dict(registry._methods))
    return method("mine", source="a test")


def test_a_parameter_without_a_declaration_is_refused_with_its_name(registered):
    with pytest.raises(TypeError, match=r"mine: rounds needs an Annotated\[type, Parameter"):

        @registered
        def mine(mesh, *, rounds=3):
            return mesh.vertices


def test_a_flag_is_never_the_truth_of_a_text(registered):
    @registered
    def mine(mesh, *, double: Annotated[bool, Parameter("whether to double the mesh")] = False):
        return mesh.vertices * (2 if double else 1)

    checked = registry.find("mine").checked
    for value in (False, True):
        assert checked({"double": value}) == checked({"double": str(value)}) == {"double": value}
    with pytest.raises(ParameterError, match="double is 'false'; it must be one of True, False"):
        checked({"double": "false"})


@pytest.mark.parametrize("returned", [lambda v: None, lambda v: v[:-1], lambda v: v[:1], lambda v: v.ravel()])
def test_a_result_that_is_not_an_array_of_vertices_is_named(registered, returned):
    @registered
    def mine(mesh):
        return returned(mesh.vertices)

    with pytest.raises(DenoiseError, match=r"mine returned .*; it must return an array of shape \(162, 3\)"):
        cn.denoise(icosphere(2), method="mine")
