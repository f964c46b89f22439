"""Every method and its parameters are settings in Blender, which errors name as the panel does."""

from typing import Annotated

import numpy as np
import pytest
from blender_objects import BALL, SINGLE, denoise, positions

import cascadenorm as cn
from cascadenorm import registry
from cascadenorm.mesh import Vectors

bpy = pytest.importorskip("bpy", reason="bpy, Blender as a module, is not installed")

from cascadenorm.frontends import blender  # noqa: E402 - imports bpy
from cascadenorm.frontends.blender.properties import parameters_of  # noqa: E402 - imports bpy


def test_every_method_and_its_parameters_are_settings_and_a_new_one_appears_by_itself(ball, monkeypatch):
    blender.unregister()
    monkeypatch.setattr(registry.methods, "_methods", dict(registry.methods._methods))

    @registry.method("shifted", source="this test")
    def shifted(mesh: cn.Mesh, *, by: Annotated[float, registry.Parameter("along x", minimum=0)] = 0.25) -> Vectors:
        return mesh.vertices + np.array([by, 0, 0])

    blender.register()
    settings = ball.cascadenorm.bl_rna.properties
    assert {item.identifier for item in settings["method"].enum_items} == set(cn.methods())
    for method in cn.methods():
        assert all(f"{method.replace('-', '_')}_{p.setting.name}" in settings for p in parameters_of(method))
    assert settings["taubin_iterations"].hard_min == 0 and settings["taubin_iterations"].default == 30
    assert bpy.ops.cascadenorm.denoise(method="shifted", shifted_by=0.5) == {"FINISHED"}
    expected = cn.denoise(SINGLE, BALL.faces, method="shifted", by=0.5)
    assert positions(ball.data.vertices).tobytes() == expected.tobytes() != SINGLE.tobytes()


def test_errors_name_settings_as_the_panel_does(ball):
    with pytest.raises(RuntimeError, match="Max displacement is 'wide'; it must be a length"):
        denoise(max_displacement="wide")
    assert positions(ball.data.vertices).tobytes() == SINGLE.tobytes()
