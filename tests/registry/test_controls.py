"""Every control is declared once, and appears everywhere."""

import importlib.util
import inspect
import json
import re
from pathlib import Path

import pytest
from shapes import icosphere

import cascadenorm as cn
from cascadenorm.api.apply import UNREPORTED
from cascadenorm.cli import options, run
from cascadenorm.io.interop import save_mesh
from cascadenorm.registry.controls import (
    CONTROLS,
    Control,
    Controls,
    ControlSetting,
    checked_controls,
    with_control_parameters,
)

ROOT = Path(__file__).parents[2]
JSON_PAGE = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")


@pytest.fixture
def docs():
    """The script that writes the tables of docs/controls.md."""
    spec = importlib.util.spec_from_file_location("control_tables", ROOT / "docs" / "generate" / "control_tables.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("function", [cn.denoise, cn.denoise_file])
def test_signatures_and_docstrings_name_every_control_with_its_default(function):
    parameters = inspect.signature(function).parameters
    text = inspect.getdoc(function)
    for name, setting in CONTROLS.items():
        assert parameters[name].default == setting.default and parameters[name].annotation == setting.kind
        assert f"\n{name}\n    {setting.about.help.split()[0]}" in text
    assert text.index("Controls\n----") < text.index("Returns\n----") < text.index("Raises\n----")


def test_what_editors_read_is_what_is_declared():
    assert list(CONTROLS) == list(Controls.__annotations__)
    assert set(inspect.signature(cn.denoise).parameters) == {*CONTROLS, "mesh", "faces", "method", "parameters"}


def test_the_command_line_has_an_option_for_every_control(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert run(["denoise", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert set(CONTROLS) - set(options.CONTROL_OPTIONS) == {"progress", "halo"}
    for setting in options.CONTROL_OPTIONS.values():
        assert re.search(rf"{setting.option}(?![\w-])", text), setting.name
        assert " ".join(setting.about.help.split()[:4]) in text


def test_the_tables_of_the_documentation_are_those_of_the_declaration(docs):
    page = docs.PAGE.read_text(encoding="utf-8")
    assert docs.with_tables(page) == page, "run python docs/generate/control_tables.py"
    with pytest.raises(SystemExit, match="markers"):
        docs.with_tables("")


def test_a_new_control_appears_wherever_controls_do(docs, monkeypatch, tmp_path):
    about = Control(help="Shine.", minimum=0, default=0.0, example=2, metavar="NUMBER")
    monkeypatch.setitem(CONTROLS, "glow", ControlSetting("glow", float, 0.0, about))
    monkeypatch.setitem(options.CONTROL_OPTIONS, "glow", CONTROLS["glow"])

    @with_control_parameters
    def work(**controls):
        """Work.

        Returns
        -------
        Nothing
        """

    assert inspect.signature(work).parameters["glow"].default == 0.0 and "\nglow\n    Shine.\n" in work.__doc__
    command = options.control_options()(lambda **controls: None)
    assert inspect.signature(command).parameters["glow"].default == 0.0
    assert checked_controls({})["glow"] == 0.0 and checked_controls({"glow": "3"})["glow"] == 3.0
    with pytest.raises(cn.ParameterError, match=r"^glow is -1; it must be at least 0$"):
        cn.denoise(icosphere(1), method="laplacian", glow=-1)
    assert "| `glow=2` | `--glow 2` | Shine. | `0.0` |\n" in docs.controls_table()
    save_mesh(tmp_path / "ball.ply", icosphere(1))
    done = cn.denoise_file(tmp_path / "ball.ply", method="laplacian", glow=3)
    assert done.controls["glow"] == 3.0


def test_examples_and_defaults_are_values_that_the_controls_take():
    checked_controls({name: setting.about.example for name, setting in CONTROLS.items()})
    assert checked_controls({}) == {name: setting.default for name, setting in CONTROLS.items()}


def test_no_method_has_a_parameter_that_is_a_control():
    for method in cn.methods().values():
        assert not set(method.settings) & set(CONTROLS), method.name


def test_every_control_that_decides_on_the_result_is_in_the_report():
    (row,) = re.findall(r"^\| `controls` \|.*$", JSON_PAGE, re.MULTILINE)
    named = set(re.findall(r"`(\w+)`", row))
    assert set(CONTROLS) - set(UNREPORTED) <= named


def keys(found):
    """Every key of an object, those of objects and lists in it included."""
    if isinstance(found, dict):
        for key, value in found.items():
            yield key
            yield from keys(value)
    elif isinstance(found, list):
        for value in found:
            yield from keys(value)


@pytest.mark.parametrize(
    "words",
    [
        ["denoise", "ball.ply", "--method", "laplacian"],
        ["inspect", "ball.ply"],
        ["compare", "ball.ply", "ball.ply"],
        ["methods", "laplacian"],
        ["evaluate", "pair", "--method", "laplacian"],
    ],
)
def test_the_schema_names_every_key(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "pair").mkdir()
    for name in ("ball.ply", "pair/noisy.ply", "pair/clean.ply"):
        save_mesh(tmp_path / name, icosphere(1))
    assert run([*words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found.pop("command") == words[0] and found.pop("version") == 1
    documented = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]+)`", JSON_PAGE))))
    assert set(keys(found)) <= documented
