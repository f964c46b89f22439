"""Settings of the Blender operator and panel, generated from the declarations of controls and methods."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from cascadenorm.api.api import DEFAULT_METHOD, methods
from cascadenorm.frontends.properties import FilterProperty, properties, settings_of
from cascadenorm.registry.controls import CONTROLS

RESULTS = [
    ("MESH", "This mesh", "Move the vertices of the mesh, or of its active shape key"),
    ("SHAPE_KEY", "Shape key", 'Keep the mesh and write the shape key "Denoised"'),
    ("COPY", "Copy", "Hide the object and denoise a copy of it; denoising the copy again starts from the original"),
]
CREASES = [
    ("NONE", "None", "No creases are given; the method alone decides what is an edge"),
    ("SHARP", "Sharp edges", "Edges marked as sharp"),
    ("SEAM", "Seams", "Edges marked as seams"),
    ("SHARP_SEAM", "Sharp edges and seams", "Edges marked as sharp or as seams"),
    ("ANGLE", "Angle", "Edges where the normals of two faces differ by more than an angle"),
]


def declarations(**options: Any) -> dict[str, Any]:
    """Return every setting by its name in Blender: those below, the controls, and the parameters of each method."""
    named = [(name, name, method.summary) for name, method in methods().items()]
    groups = "Vertex group whose weights scale the displacement of each vertex"
    edges = CONTROLS["creases"].about.help
    return {
        "method": bpy.props.EnumProperty(name="Method", items=named, default=DEFAULT_METHOD, **options),
        "result": bpy.props.EnumProperty(name="Result", items=RESULTS, default="MESH", **options),
        "vertex_group": bpy.props.StringProperty(name="Mask", description=groups, **options),
        "invert_vertex_group": bpy.props.BoolProperty(
            name="Invert", description="Subtract its weights from 1", **options
        ),
        "creases": bpy.props.EnumProperty(name="Creases", items=CREASES, default="NONE", description=edges, **options),
        "crease_angle": bpy.props.FloatProperty(
            name="Angle",
            description="Angle between face normals above which an edge is a crease",
            subtype="ANGLE",
            default=np.radians(40.0),
            min=0.0,
            max=np.pi,
            **options,
        ),
        **{identifier(property): _declared(property, options) for property in _generic()},
    }


def identifier(property: FilterProperty) -> str:
    """Return the name of a property in scripts, such as keep_detail or taubin_iterations."""
    return "_".join(filter(None, [property.method.replace("-", "_"), property.setting.name]))


def label(name: str, value: object = None) -> str:
    """Return the label of a control or a parameter in the panel, for messages."""
    if name == "mask":
        return "Mask"
    text = name.replace("_", " ").capitalize()
    return text if value is None else f"{text} = {value}"


def parameters_of(method: str) -> list[FilterProperty]:
    return [property for property in _generic() if property.method == method]


def denoise_arguments(settings: Any) -> dict[str, Any]:
    """Return settings as arguments of `denoise`, except mask and creases. Raises ParameterError for invalid ones."""
    values = {}
    for property in _generic():
        name = identifier(property)
        if settings.is_property_set(name):
            values[property.name] = _value(property, getattr(settings, name))
    return {"method": settings.method, **settings_of(values, settings.method)}


def _generic() -> Iterator[FilterProperty]:
    """Yield all properties except arrays, for which Blender uses vertex groups and edge marks."""
    arrays = {name for name, control in CONTROLS.items() if control.about.arrays}
    return (property for property in properties() if property.method or property.setting.name not in arrays)


def _declared(property: FilterProperty, options: dict[str, Any]) -> Any:
    """Declare a number with its range, a choice, a path or text, which is empty if the default is None."""
    setting = property.setting
    about = {"name": label(setting.name), "description": property.help.removesuffix("."), **options}
    if setting.choices:
        items = [(name, name, "") for name in setting.choice_names]
        default = "none" if setting.default is None else str(setting.default)
        return bpy.props.EnumProperty(**about, items=items, default=default)
    if setting.kinds == (int,) and not setting.optional:
        return bpy.props.IntProperty(**about, **_range(property), default=setting.default)
    if setting.kinds == (float,) and not setting.optional:
        return bpy.props.FloatProperty(**about, **_range(property), default=setting.default, precision=3, step=5)
    kind = {"subtype": "FILE_PATH"} if Path in setting.kinds else {}
    return bpy.props.StringProperty(**about, **kind)


def _range(property: FilterProperty) -> dict[str, Any]:
    about, kind = property.setting.about, property.setting.kinds[0]
    lower = about.above if about.minimum is None else about.minimum
    upper = about.below if about.maximum is None else about.maximum
    limits = {"min": lower, "max": upper}
    return {name: kind(limit) for name, limit in limits.items() if limit is not None and np.isfinite(limit)}


def _value(property: FilterProperty, value: Any) -> Any:
    """Convert a Blender value to the type of its setting; a float32 is read as its shortest decimal."""
    setting = property.setting
    if isinstance(value, float):
        value = float(str(np.float32(value)))
    if value == "" and isinstance(value, str):
        return setting.default
    if Path in setting.kinds:
        return Path(bpy.path.abspath(value))
    return setting.checked(value)
