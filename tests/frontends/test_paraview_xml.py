"""Every control and parameter is declared to ParaView."""

from xml.etree import ElementTree

import pytest

import cascadenorm as cn
from cascadenorm.registry.controls import CONTROLS

pytest.importorskip("vtkmodules")
from cascadenorm.frontends.paraview_xml import declaration
from cascadenorm.frontends.properties import properties
from cascadenorm.frontends.vtk_filter import DenoiseFilter


def test_every_control_and_parameter_is_a_property_of_filter_and_plugin():
    names = {property.name for property in properties()}
    assert len(names) == len(list(properties()))
    assert {"Strength", "KeepDetail", "MaxDisplacement", "TaubinIterations", "AutoModel"} <= names
    assert len(names) == sum(not control.about.hidden for control in CONTROLS.values()) + sum(
        len(method.given_by_name) for method in cn.methods().values()
    )
    elements = ElementTree.fromstring(f"<Proxy>{declaration()}</Proxy>")
    assert {element.get("name") for element in elements} == {"Input", "Method", *names}
    filter = DenoiseFilter()
    methods = {value.get("value") for value in elements.find("*[@name='Method']").iter("String")}
    assert methods == set(cn.methods())
    for element in elements:
        if element.get("name") != "Input":
            before = filter.GetMTime()
            getattr(filter, element.get("command"))(element.get("default_values"))  # the default is admitted
            assert filter.GetMTime() == before  # and changes nothing
        for decorator in element.iter("PropertyWidgetDecorator"):
            assert decorator.get("value") in methods
