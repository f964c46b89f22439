"""The properties of the filter as XML declarations for ParaView."""

from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

from cascadenorm.api.api import DEFAULT_METHOD, methods
from cascadenorm.frontends.properties import FilterProperty, properties
from cascadenorm.frontends.vtk_filter import INPUT_TYPES


def declaration() -> str:
    """Return the elements of the input and of every property; those of a method are shown when it is selected."""
    given = Element("InputProperty", name="Input", command="SetInputConnection")
    groups = SubElement(given, "ProxyGroupDomain", name="groups")
    groups.extend([Element("Group", name=name) for name in ("sources", "filters")])
    kinds = SubElement(given, "DataTypeDomain", name="input_type", composite_data_supported="1")
    kinds.extend([Element("DataType", value=kind) for kind in INPUT_TYPES])

    method = _vector("String", "Method", DEFAULT_METHOD, "How the mesh is denoised.")
    _choices(method, list(methods()))
    return "".join(tostring(one, encoding="unicode") for one in (given, method, *map(_element, properties())))


def _element(property: FilterProperty) -> Element:
    """Declare a number with its range, a choice, or text, which may be empty if the default is None."""
    setting = property.setting
    number = {(float,): "Double", (int,): "Int"}.get(setting.kinds) if not setting.optional else None
    if setting.choices:
        element = _vector("String", property.name, property.default or "none", property.help)
        _choices(element, setting.choice_names)
    else:
        element = _vector(number or "String", property.name, property.default, property.help)
    if number and not setting.choices:
        limits = {"min": setting.about.minimum, "max": setting.about.maximum}
        known = {name: f"{limit:g}" for name, limit in limits.items() if limit is not None}
        SubElement(element, f"{number}RangeDomain", {"name": "range", **known})
    if property.method:
        hints = SubElement(element, "Hints")
        shown = {"type": "GenericDecorator", "mode": "visibility", "property": "Method", "value": property.method}
        SubElement(hints, "PropertyWidgetDecorator", shown)
    return element


def _vector(kind: str, name: str, default: Any, help: str) -> Element:
    element = Element(f"{kind}VectorProperty", name=name, command=f"Set{name}")
    element.attrib |= {"number_of_elements": "1", "default_values": str(default)}
    SubElement(element, "Documentation").text = help
    return element


def _choices(element: Element, values: list[str]) -> None:
    SubElement(element, "StringListDomain", name="list").extend([Element("String", value=one) for one in values])
