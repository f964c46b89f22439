"""Methods that are registered from outside the package."""

import inspect
import re
from typing import Annotated

import numpy as np
import pytest
from shapes import icosphere

import cascadenorm as cn
from cascadenorm.errors import DenoiseError, ParameterError
from cascadenorm.mesh import Mesh
from cascadenorm.registry import Parameter, method
from cascadenorm.registry import methods as registry


@pytest.fixture
def registered(monkeypatch):
    """A function that registers another one as the method `mine` during a test."""
    monkeypatch.setattr(registry, "_methods", cn.methods())  # a copy, after all methods have been registered
    return method("mine", source="a test")


def test_a_parameter_without_a_declaration_is_refused_with_its_name(registered):
    with pytest.raises(TypeError, match=r"mine: rounds needs an Annotated\[type, Parameter"):

        @registered
        def mine(mesh, *, rounds=3):
            return mesh.vertices


def test_a_parameter_without_a_default_is_refused_with_its_name(registered):
    with pytest.raises(TypeError, match="mine: rounds needs a default value"):

        @registered
        def mine(mesh, *, rounds: Annotated[int, Parameter("Number of rounds")]):
            return mesh.vertices


def test_a_parameter_that_is_not_keyword_only_is_refused_with_its_name(registered):
    with pytest.raises(TypeError, match="mine: rounds must be a keyword-only parameter"):

        @registered
        def mine(mesh, rounds: Annotated[int, Parameter("Number of rounds")] = 3):
            return mesh.vertices

    assert "mine" not in cn.methods()


def test_a_method_of_another_module_is_not_replaced(registered):
    def mine(mesh):
        return mesh.vertices

    with pytest.raises(ParameterError, match=r"baselines\.\w+ registers a method 'taubin' already"):
        method("taubin", source="a test")(mine)
    for _ in range(2):  # as a cell of a notebook that runs again
        registered(mine)
    assert cn.methods()["mine"].function is mine
    assert cn.methods()["taubin"].family == "smoothing"


@pytest.mark.parametrize("name", ["strength", "mask", "method"])
def test_a_parameter_that_is_named_as_a_setting_of_denoise_is_refused(registered, name):
    def mine(mesh, **settings):
        return mesh.vertices

    first = inspect.Parameter("mesh", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    taken = inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=1.0)
    mine.__signature__ = inspect.Signature([first, taken])
    with pytest.raises(ParameterError, match=f"mine: {name} is a setting of denoise: rename the parameter"):
        registered(mine)
    assert "mine" not in cn.methods()


def test_a_flag_is_never_the_truth_of_a_text(registered):
    @registered
    def mine(mesh, *, double: Annotated[bool, Parameter("whether to double the mesh")] = False):
        return mesh.vertices * (2 if double else 1)

    checked = registry.find("mine").checked
    for value in (False, True):
        assert checked({"double": value}) == checked({"double": str(value)}) == {"double": value}
    for wrong in ("false", np.ones(2)):
        with pytest.raises(ParameterError, match=r"double is .*; it must be one of True, False"):
            checked({"double": wrong})


@pytest.mark.parametrize(
    ("returned", "named"),
    [
        (lambda v: None, "NoneType of shape ()"),
        (lambda v: v[:-1], "ndarray of shape (161, 3)"),
        (lambda v: v[:1], "ndarray of shape (1, 3)"),
        (lambda v: v.ravel(), "ndarray of shape (486,)"),
        (lambda v: Mesh(v, [(0, 1, 2)]), "Mesh of shape ()"),
        (lambda v: v * 1j, "ndarray of shape (162, 3) and type complex128"),
        (lambda v: v.astype(object), "ndarray of shape (162, 3) and type object"),
        (lambda v: [*v, [0.0]], "rows of different lengths"),
    ],
)
def test_a_result_that_is_not_an_array_of_vertices_is_named(registered, returned, named):
    @registered
    def mine(mesh):
        return returned(mesh.vertices)

    with pytest.raises(DenoiseError, match=rf"mine returned {re.escape(named)}.*; it must return .* \(162, 3\)"):
        cn.denoise(icosphere(2), method="mine")
    with pytest.raises(DenoiseError, match=rf"mine returned {re.escape(named.partition('(')[0])}.*; it must return"):
        cn.denoise(icosphere(2), method="mine", remove_detail="2 edges")
