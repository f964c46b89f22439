"""The extension of Blender: operators that denoise and inspect, and their panel."""

from typing import Any

import bpy

from cascadenorm.frontends.blender.operators import Denoise, DenoisePanel, Inspect
from cascadenorm.frontends.blender.properties import declarations


class ObjectSettings(bpy.types.PropertyGroup):
    """Denoising settings and inspection result of an object, saved in the Blender file."""


CLASSES = (ObjectSettings, Denoise, Inspect, DenoisePanel)


def register() -> None:
    """Register the operators, the panel and the object settings, with the methods that are registered now."""
    Denoise.__annotations__ = declarations(options={"SKIP_SAVE"})  # each run takes those of the panel anew
    ObjectSettings.__annotations__ = {
        **declarations(),
        "source": bpy.props.PointerProperty(name="Source", type=bpy.types.Object),
        "found": bpy.props.StringProperty(name="Found"),
    }
    for kind in CLASSES:
        bpy.utils.register_class(kind)
    bpy.types.Object.cascadenorm = bpy.props.PointerProperty(type=ObjectSettings)
    bpy.types.VIEW3D_MT_object.append(_menu)
    bpy.types.VIEW3D_MT_edit_mesh_vertices.append(_menu)


def unregister() -> None:
    """Undo `register`."""
    bpy.types.VIEW3D_MT_edit_mesh_vertices.remove(_menu)
    bpy.types.VIEW3D_MT_object.remove(_menu)
    del bpy.types.Object.cascadenorm
    for kind in reversed(CLASSES):
        bpy.utils.unregister_class(kind)


def _menu(self: Any, context: Any) -> None:
    """Draw the entry of the menus Object, and Vertex of Edit mode."""
    self.layout.operator("cascadenorm.denoise")
