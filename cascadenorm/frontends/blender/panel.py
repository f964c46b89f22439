"""The panel in the sidebar of the 3-D view, tab Denoise."""

from textwrap import wrap
from typing import Any

import bpy

from cascadenorm.controls import CONTROLS
from cascadenorm.frontends.blender.properties import identifier, label, parameters_of

WIDTH = 42
"""Characters of a line of text in the panel."""


class DenoisePanel(bpy.types.Panel):
    """Inspection result and settings of the active object, with the operators."""

    bl_idname = "VIEW3D_PT_cascadenorm"
    bl_label = "Denoise"
    bl_category = "Denoise"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Whether the active object has a mesh."""
        return context.object is not None and context.object.type == "MESH"

    def draw(self, context: Any) -> None:
        """Draw the panel."""
        settings, layout = context.object.cascadenorm, self.layout
        layout.operator("cascadenorm.inspect", icon="VIEWZOOM")
        for line in settings.found.splitlines():
            for part in wrap(line, WIDTH):
                layout.label(text=part)
        layout.operator("cascadenorm.denoise", icon="MOD_SMOOTH")
        if settings.source:
            layout.label(text=f"From {settings.source.name}", icon="LINKED")
        draw_settings(layout, settings, context.object)


def draw_settings(layout: Any, settings: Any, object: Any) -> None:
    """Draw the settings of an operator or an object, with the parameters of the selected method."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    for name in ("method", "strength", "result"):
        layout.prop(settings, name)
    parameters = parameters_of(settings.method)
    if parameters:
        box = layout.box()
        for property in parameters:
            box.prop(settings, identifier(property), text=label(property.setting.name))
    row = layout.row(align=True)
    row.prop_search(settings, "vertex_group", object, "vertex_groups")
    row.prop(settings, "invert_vertex_group", text="", icon="ARROW_LEFTRIGHT")
    layout.prop(settings, "creases")
    if settings.creases == "ANGLE":
        layout.prop(settings, "crease_angle")
    for name, control in CONTROLS.items():
        if name != "strength" and not control.about.hidden and not control.about.arrays:
            layout.prop(settings, name)
