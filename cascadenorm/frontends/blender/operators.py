"""Operators that denoise the selection and inspect the active object, and their panel, tab Denoise in the 3-D view."""

from collections.abc import Callable
from textwrap import wrap
from typing import Any, ClassVar

import bpy
import numpy as np
from numpy.typing import NDArray

from cascadenorm.api.api import denoise
from cascadenorm.api.inspection import inspect
from cascadenorm.api.inspection.findings import FINDINGS
from cascadenorm.errors import CascadenormError, counted
from cascadenorm.execution.progress import Cancelled, Listener, report_to
from cascadenorm.frontends.blender.properties import declarations, denoise_arguments, identifier, label, parameters_of
from cascadenorm.frontends.blender.surfaces import (
    Surface,
    copy_of,
    creases_of,
    mask_of,
    surface_of,
    write_positions,
    write_shape_key,
)
from cascadenorm.frontends.jobs import BackgroundJob
from cascadenorm.registry.controls import CONTROLS

PANEL_WIDTH = 42  # characters of a line of text in the panel


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
        settings, layout = context.object.cascadenorm, self.layout
        layout.operator("cascadenorm.inspect", icon="VIEWZOOM")
        for line in settings.found.splitlines():
            for part in wrap(line, PANEL_WIDTH):
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


BackgroundWork = Callable[[Listener], Any]

TICK = 0.1  # seconds between two polls of the work
VIEWING = {"MIDDLEMOUSE", "WHEELUPMOUSE", "WHEELDOWNMOUSE", "TRACKPADPAN", "TRACKPADZOOM", "NDOF_MOTION"}
"""Events that change the view, which stay allowed while the work runs."""


class Working(bpy.types.Operator):
    """An operator that works in a thread and is cancelled by Esc. Called from a script, it returns when it is done."""

    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Whether there is a mesh to work on, in Object or Edit mode."""
        return context.mode in {"OBJECT", "EDIT_MESH"} and bool(targets(context))

    def execute(self, context: Any) -> set[str]:
        """Do the work and return when it is done."""
        try:
            self.finish(context, self.prepare(context)(lambda fraction: None))
        except CascadenormError as error:
            self.report({"ERROR"}, error.message(label))
            return {"CANCELLED"}
        return {"FINISHED"}

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Start the work in a thread."""
        try:
            self._job = BackgroundJob(self.prepare(context))
        except CascadenormError as error:
            self.report({"ERROR"}, error.message(label))
            return {"CANCELLED"}
        manager = context.window_manager
        manager.progress_begin(0, 100)
        self._timer = manager.event_timer_add(TICK, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """Show the progress, and write the result when it is ready."""
        if event.type == "ESC":
            self._job.cancel()
        elif event.type in VIEWING:
            return {"PASS_THROUGH"}
        if not self._job.done:
            context.window_manager.progress_update(100 * self._job.fraction)
            state = "cancelling" if self._job.cancelled else f"{self._job.fraction:.0%}, Esc cancels"
            context.workspace.status_text_set(f"{self.bl_label}: {state}")
            return {"RUNNING_MODAL"}
        context.window_manager.event_timer_remove(self._timer)
        context.window_manager.progress_end()
        context.workspace.status_text_set(None)
        try:
            self.finish(context, self._job.result())
        except Cancelled:
            self.report({"INFO"}, "Nothing has changed")
            return {"CANCELLED"}
        except CascadenormError as error:
            self.report({"ERROR"}, error.message(label))
            return {"CANCELLED"}
        return {"FINISHED"}

    def prepare(self, context: Any) -> BackgroundWork:
        """Read what the work needs from Blender, and return the work."""
        raise NotImplementedError

    def finish(self, context: Any, result: Any) -> None:
        """Write the result of the work."""
        raise NotImplementedError


class Denoise(Working):
    """Denoise the selected meshes, in Edit mode their selected vertices"""

    bl_idname = "cascadenorm.denoise"
    bl_label = "Denoise"

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Use the settings of the active object unless others are given, and start."""
        settings = context.object.cascadenorm
        for name in declarations():
            if settings.is_property_set(name) and not self.properties.is_property_set(name):
                setattr(self.properties, name, getattr(settings, name))
        return super().invoke(context, event)

    def draw(self, context: Any) -> None:
        draw_settings(self.layout, self.properties, context.object)

    def prepare(self, context: Any) -> BackgroundWork:
        self._objects, given = targets(context), self.properties
        surfaces = [surface_of(object) for object in self._objects]
        settings = [
            {**denoise_arguments(given), "mask": mask_of(object, given), "creases": creases_of(object, given)}
            for object in self._objects
        ]

        def work(listener: Listener) -> list[NDArray[np.float32]]:
            return [
                _denoised(surface, arguments, listener, i / len(surfaces), 1 / len(surfaces))
                for i, (surface, arguments) in enumerate(zip(surfaces, settings, strict=True))
            ]

        return work

    def finish(self, context: Any, result: list[NDArray[np.float32]]) -> None:
        editing = context.mode == "EDIT_MESH"
        if editing:
            bpy.ops.object.mode_set(mode="OBJECT")
        for object, positions in zip(self._objects, result, strict=True):
            self._write(context, object, positions)
        if editing:
            bpy.ops.object.mode_set(mode="EDIT")

    def _write(self, context: Any, object: Any, positions: NDArray[np.float32]) -> None:
        object.cascadenorm.found = ""
        if self.properties.result == "COPY" and object.cascadenorm.source is None:
            copy = copy_of(object)
            for name in declarations():
                if self.properties.is_property_set(name):
                    setattr(copy.cascadenorm, name, getattr(self.properties, name))
            if context.view_layer.objects.active == object:
                context.view_layer.objects.active = copy
            object = copy
        if self.properties.result == "SHAPE_KEY":
            write_shape_key(object, positions)
        else:
            write_positions(object, positions)


class Inspect(Working):
    """Determine the kind and size of the error of the active object, and list the defects of its mesh"""

    bl_idname = "cascadenorm.inspect"
    bl_label = "Inspect"

    def prepare(self, context: Any) -> BackgroundWork:
        self._object = context.object
        surface = surface_of(self._object)

        def work(listener: Listener) -> str:
            with report_to(listener):
                found = inspect(surface.vertices, surface.faces)
            kind = "Too large to determine the error" if found.error is None else str(found.error)
            defects = [counted(value.count, *FINDINGS[name]) for name, value in found.findings.items()]
            return "\n".join([kind[:1].upper() + kind[1:], *defects])

        return work

    def finish(self, context: Any, result: str) -> None:
        self._object.cascadenorm.found = result


def targets(context: Any) -> list[Any]:
    """Return the objects to process, one for each mesh: those in Edit mode, else the selected ones, else the active."""
    if context.mode == "EDIT_MESH":
        return list(context.objects_in_mode_unique_data)
    objects = [o for o in context.selected_objects or [context.object] if o is not None and o.type == "MESH"]
    return list({object.data: object for object in objects if object.data.library is None}.values())


def _denoised(
    surface: Surface, settings: dict[str, Any], listener: Listener, begin: float, length: float
) -> NDArray[np.float32]:
    """Return the new positions of a surface; its progress is a part of the whole."""

    def listen(fraction: float) -> None:
        listener(begin + length * fraction)

    return surface.positions_of(denoise(surface.vertices, surface.faces, progress=listen, **settings))
