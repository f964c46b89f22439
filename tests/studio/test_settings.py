"""The form has every setting, and no setting names a file."""

import pytest

import cascadenorm as cn
from cascadenorm.registry.controls import CONTROLS


@pytest.mark.parametrize(
    "settings",
    [
        {"controls": {"mask": "/tmp/weights.npy"}},
        {"controls": {"fixed": "secret.TXT"}},
        {"controls": {"creases": "edges.txt "}},
        {"parameters": {"model": "weights.safetensors"}},
    ],
    ids=str,
)
def test_settings_name_no_files(studio, settings):
    status, answer = studio.asked("POST", "/api/recipe", {"settings": settings, "name": "out.ply"})
    assert status == 400 and "reads no file but the mesh" in answer["error"]


def test_the_form_has_every_method_and_control_and_its_defaults_change_nothing(studio):
    form = studio.asked("GET", "/api/form")[1]
    assert sorted(method["name"] for method in form["methods"]) == list(cn.methods())
    families = [method["family"] for method in form["methods"]]
    assert families[0] == "Learned" and len(set(families)) >= 5
    assert families == sorted(families, key=families.index)  # those of a family follow each other
    assert [control["name"] for control in form["controls"]] == [n for n, c in CONTROLS.items() if not c.about.hidden]
    for method in form["methods"]:
        registered = cn.methods()[method["name"]]
        offered = {setting["name"]: setting["default"] for setting in method["settings"]}
        assert offered.keys() == {setting.name for setting in registered.given_by_name} - {"model"}
        given = {name: default for name, default in offered.items() if default}
        read = registered.checked(given)
        assert read == {name: registered.settings[name].default for name in given}
