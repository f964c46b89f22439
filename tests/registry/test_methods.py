"""Methods that are registered from outside the package."""

import pytest

from cascadenorm.registry import method
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
