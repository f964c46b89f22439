"""The extension of Blender in Blender itself: operators, attributes kept, undo, files; the zip as Blender reads it."""

import subprocess
import sys
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from blender_zip import build
from shapes import icosphere, noisy

import cascadenorm as cn
from cascadenorm import registry
from cascadenorm.mesh import Vectors

bpy = pytest.importorskip("bpy", reason="bpy, Blender as a module, is not installed")

from cascadenorm.frontends import blender  # noqa: E402 - imports bpy
from cascadenorm.frontends.blender import surfaces  # noqa: E402
from cascadenorm.frontends.blender.properties import parameters_of  # noqa: E402

BALL = noisy(icosphere(2), 0.2)
SINGLE = BALL.vertices.astype(np.float32)
RIGHT = SINGLE[:, 0] > 0
METHOD = {"method": "bilateral-normal", "bilateral_normal_iterations": 5}


@pytest.fixture
def ball():
    """The noisy ball as the active object of an empty file, the extension registered."""
    blender.register()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mesh = bpy.data.meshes.new("ball")
    mesh.from_pydata(SINGLE.tolist(), [], BALL.faces.tolist())
    made = bpy.data.objects.new("ball", mesh)
    bpy.context.collection.objects.link(made)
    bpy.context.view_layer.objects.active = made
    made.select_set(True)
    yield made
    if bpy.context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    blender.unregister()


def positions(elements):
    flat = np.empty(len(elements) * 3, np.float32)
    elements.foreach_get("co", flat)
    return flat.reshape(-1, 3)


def denoised(**controls):
    return cn.denoise(SINGLE, BALL.faces, method="bilateral-normal", iterations=5, **controls)


def denoise(**settings):
    assert bpy.ops.cascadenorm.denoise("EXEC_DEFAULT", True, **{**METHOD, **settings}) == {"FINISHED"}


def active():
    return bpy.context.view_layer.objects.active


def test_it_moves_the_mesh_as_python_does_and_undo_brings_it_back(ball):
    bpy.ops.ed.undo_push(message="before")
    denoise(strength=0.3)  # of which single precision makes 0.30000001
    assert positions(ball.data.vertices).tobytes() == denoised(strength=0.3).tobytes()
    bpy.ops.ed.undo()
    assert positions(active().data.vertices).tobytes() == SINGLE.tobytes()
    bpy.ops.ed.redo()
    assert positions(active().data.vertices).tobytes() == denoised(strength=0.3).tobytes()


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


def test_all_else_in_the_mesh_is_kept(ball):
    mesh = ball.data
    mesh.uv_layers.new(name="map").data.foreach_set("uv", np.linspace(0, 1, 2 * len(mesh.loops)))
    mesh.color_attributes.new("paint", "BYTE_COLOR", "CORNER").data[7].color = (1, 0.5, 0, 1)
    mesh.attributes.new("heat", "FLOAT", "POINT").data[3].value = 37.5
    mesh.normals_split_custom_set_from_vertices([(0.6, 0, 0.8)] * len(mesh.vertices))
    mesh.edges[5].use_seam = True
    before = {layer.name: bytes_of(layer) for layer in mesh.attributes if layer.name != "position"}
    denoise()
    assert {layer.name: bytes_of(layer) for layer in mesh.attributes if layer.name != "position"} == before
    assert {"map", "paint", "heat", "uv_seam"} <= {name.lstrip(".") for name in before} | {"uv_seam"}
    assert mesh.edges[5].use_seam and mesh.has_custom_normals


def bytes_of(layer):
    values = [
        next(getattr(item, n) for n in ("value", "vector", "color", "uv") if hasattr(item, n)) for item in layer.data
    ]
    return np.array([tuple(v) if hasattr(v, "__len__") else v for v in values]).tobytes()


def test_normals_stored_as_vectors_are_made_anew(ball):
    layer = ball.data.attributes.new("custom_normal", "FLOAT_VECTOR", "POINT")
    if not ball.data.has_custom_normals:
        pytest.skip("this Blender, before 5.0, has no normals that are vectors")
    layer.data.foreach_set("vector", BALL.vertex_normals.astype(np.float32).ravel())
    denoise()
    stored = np.empty(3 * len(SINGLE), np.float32)
    ball.data.attributes["custom_normal"].data.foreach_get("vector", stored)
    new = cn.Mesh(positions(ball.data.vertices), BALL.faces)
    assert (np.einsum("ij,ij->i", stored.reshape(-1, 3), new.vertex_normals) > 0.99).all()
    assert np.abs(stored.reshape(-1, 3) - BALL.vertex_normals).max() > 0.05


def test_a_vertex_group_is_the_mask(ball):
    group = ball.vertex_groups.new(name="right")
    group.add(np.flatnonzero(RIGHT).tolist(), 0.5, "REPLACE")
    denoise(vertex_group="right")
    assert positions(ball.data.vertices).tobytes() == denoised(mask=RIGHT * 0.5).tobytes()
    assert positions(ball.data.vertices)[~RIGHT].tobytes() == SINGLE[~RIGHT].tobytes()
    ball.data.vertices.foreach_set("co", SINGLE.ravel())
    denoise(vertex_group="right", invert_vertex_group=True)
    assert positions(ball.data.vertices).tobytes() == denoised(mask=1 - RIGHT * 0.5).tobytes()
    with pytest.raises(RuntimeError, match="Mask is 'left', which ball does not have"):
        denoise(vertex_group="left")


@pytest.mark.parametrize("mark", ["SHARP", "SEAM", "ANGLE"])
def test_marked_edges_or_an_angle_are_creases(ball, mark):
    edges = np.array([edge.vertices[:] for edge in ball.data.edges])
    chosen = (SINGLE[edges, 2] > 0).sum(axis=1) == 1
    for i in np.flatnonzero(chosen):
        setattr(ball.data.edges[i], "use_seam" if mark == "SEAM" else "use_edge_sharp", True)
    expected = denoised(creases=25.0 if mark == "ANGLE" else edges[chosen])
    denoise(creases=mark, crease_angle=np.radians(25))
    assert positions(ball.data.vertices).tobytes() == expected.tobytes() != denoised().tobytes()


def test_edit_mode_denoises_what_is_selected(ball):
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    ball.data.vertices.foreach_set("select", RIGHT)
    bpy.ops.object.mode_set(mode="EDIT")
    denoise()
    assert ball.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert positions(ball.data.vertices).tobytes() == denoised(mask=RIGHT).tobytes()
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="DESELECT")
    with pytest.raises(RuntimeError, match="no vertex is selected"):
        denoise()


def test_polygons_are_cut_and_the_scale_of_the_object_counts(ball):
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=12, y_subdivisions=12)
    grid = active()
    grid.data.vertices.foreach_set("co", noisy_grid(positions(grid.data.vertices)).ravel())
    before, quads = positions(grid.data.vertices), len(grid.data.polygons)
    grid.scale = (2, 2, 5)
    bpy.context.view_layer.update()
    denoise(max_displacement="0.01")
    moved = np.linalg.norm((positions(grid.data.vertices) - before) * (2, 2, 5), axis=1)
    assert 0.0099 < moved.max() < 0.01001 and len(grid.data.polygons) == quads == 144


def noisy_grid(points):
    return points + np.random.default_rng(0).normal(size=points.shape).astype(np.float32) * (0, 0, 0.05)


def test_the_result_as_a_shape_key_keeps_the_mesh(ball):
    for strength in (1.0, 0.5):  # the second run begins from the mesh again
        denoise(result="SHAPE_KEY", strength=strength)
        keys = ball.data.shape_keys.key_blocks
        assert [key.name for key in keys] == ["Basis", surfaces.RESULT] and keys[surfaces.RESULT].value == 1
        assert positions(keys["Basis"].data).tobytes() == SINGLE.tobytes()
        assert positions(keys[surfaces.RESULT].data).tobytes() == denoised(strength=strength).tobytes()


def test_keys_that_are_relative_to_the_denoised_one_move_along(ball):
    ball.shape_key_add(name="Basis")
    open_mouth = ball.shape_key_add(name="open")
    open_mouth.data.foreach_set("co", (SINGLE + np.array([0, 0, 1])).astype(np.float32).ravel())
    ball.active_shape_key_index = 0
    denoise()
    np.testing.assert_allclose(positions(open_mouth.data), denoised() + np.array([0, 0, 1]), atol=1e-6)
    assert positions(ball.data.vertices).tobytes() == denoised().tobytes()


def test_a_copy_is_made_again_from_the_object_it_came_from_also_from_a_saved_file(ball, tmp_path):
    denoise(result="COPY", strength=0.5)
    copy = active()
    assert copy.name == "ball denoised" and copy.cascadenorm.source == ball and ball.hide_get()
    assert positions(copy.data.vertices).tobytes() == denoised(strength=0.5).tobytes()
    assert positions(ball.data.vertices).tobytes() == SINGLE.tobytes()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "copy.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "copy.blend"))
    copy = active()
    assert (copy.cascadenorm.method, round(copy.cascadenorm.strength, 6)) == ("bilateral-normal", 0.5)
    denoise()
    assert positions(copy.data.vertices).tobytes() == denoised().tobytes()
    source = copy.cascadenorm.source
    source.data.clear_geometry()
    with pytest.raises(RuntimeError, match="has 162 vertices, but ball, its original, has 0: make a new copy"):
        denoise()


def test_inspect_tells_the_kind_of_error_and_what_is_wrong(ball):
    ball.data.vertices[0].co = ball.data.vertices[1].co
    assert bpy.ops.cascadenorm.inspect() == {"FINISHED"}
    kind, *defects = ball.cascadenorm.found.splitlines()
    assert "noise of 0." in kind and any("coincides with an earlier one" in line for line in defects)
    denoise()
    assert ball.cascadenorm.found == ""


def test_errors_name_settings_as_the_panel_does(ball):
    with pytest.raises(RuntimeError, match="Max displacement is 'wide'; it must be a length"):
        denoise(max_displacement="wide")
    assert positions(ball.data.vertices).tobytes() == SINGLE.tobytes()


def test_blender_takes_the_zip(tmp_path):
    path = build.packed(build.own_wheel(tmp_path), "linux-x64", "3.11", tmp_path)
    (checker,) = Path(bpy.utils.resource_path("LOCAL")).glob("scripts/addons_core/bl_pkg/cli/blender_ext.py")
    done = subprocess.run([sys.executable, checker, "validate", path], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
