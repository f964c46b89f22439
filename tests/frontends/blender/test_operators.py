"""The operators denoise and inspect what is active or selected, and undo brings it back."""

import pytest
from blender_objects import RIGHT, SINGLE, active, denoise, denoised, positions

bpy = pytest.importorskip("bpy", reason="bpy, Blender as a module, is not installed")


def test_it_moves_the_mesh_as_python_does_and_undo_brings_it_back(ball):
    bpy.ops.ed.undo_push(message="before")
    denoise(strength=0.3)  # of which single precision makes 0.30000001
    assert positions(ball.data.vertices).tobytes() == denoised(strength=0.3).tobytes()
    bpy.ops.ed.undo()
    assert positions(active().data.vertices).tobytes() == SINGLE.tobytes()
    bpy.ops.ed.redo()
    assert positions(active().data.vertices).tobytes() == denoised(strength=0.3).tobytes()


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
