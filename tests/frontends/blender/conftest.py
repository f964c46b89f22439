"""The object that tests denoise in Blender."""

import pytest


@pytest.fixture
def ball():
    """The noisy ball as the active object of an empty file, the extension registered."""
    import bpy
    from blender_objects import BALL, SINGLE

    from cascadenorm.frontends import blender

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
