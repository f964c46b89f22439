"""The form of the studio, generated from the declarations of methods and controls, and the settings it returns."""

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from cascadenorm.api.api import DEFAULT_METHOD
from cascadenorm.api.selection import ARRAY_FILES
from cascadenorm.errors import ParameterError
from cascadenorm.registry import Method, Setting, by_family, find
from cascadenorm.registry.controls import CONTROLS, Controls, checked_controls
from cascadenorm.studio.names import label

MOST_LETTERS = 10_000  # longest text of a setting, in characters


class Chosen(NamedTuple):
    """A method with its parameters and controls; `given` has the controls that were set."""

    method: Method
    parameters: dict[str, Any]
    controls: Controls
    given: dict[str, Any]


def form() -> dict[str, Any]:
    """Return the description of the form: the methods by family, with their parameters, and the controls in order."""
    offered = [control for control in CONTROLS.values() if not control.about.hidden]
    return {
        "default": DEFAULT_METHOD,
        "methods": [
            {
                "name": method.name,
                "family": family.title,
                "about": family.about,
                "summary": method.summary,
                "source": method.source,
                "settings": [_input(setting) for setting in method.given_by_name if _fits(setting)],
            }
            for family, members in by_family().items()
            for method in members
        ],
        "controls": [{**_input(control), "example": _text(control.about.example)} for control in offered],
    }


def chosen(given: Mapping[str, Any]) -> Chosen:
    """Parse the method, parameters and controls of a request. Raises ParameterError if a value is not accepted."""
    method = find(str(given.get("method", DEFAULT_METHOD)))
    parameters, controls = (_plain(given.get(kind, {})) for kind in ("parameters", "controls"))
    for name, value in {**parameters, **controls}.items():
        setting = method.settings.get(name) if name in parameters else CONTROLS.get(name)
        if setting is not None and (not _fits(setting) or _names_a_file(setting, value)):
            raise ParameterError("is a file, and the studio reads no file but the mesh", parameter=name)
    if "progress" in controls:
        raise ParameterError("cannot be set in the studio", parameter="progress")
    return Chosen(method, method.checked(parameters), checked_controls(controls), controls)


def _input(setting: Setting) -> dict[str, Any]:
    """Describe a setting, for which the browser creates an input."""
    about = setting.about
    number = setting.kinds in ((int,), (float,))
    return {
        "name": setting.name,
        "label": label(setting.name),
        "help": about.help,
        "unit": about.unit,
        "allowed": about.allowed,
        "kind": "choice" if setting.choices else "number" if number else "text",
        "whole": setting.kinds == (int,),
        "choices": setting.choice_names,
        "default": "none" if setting.default is None and setting.choices else _text(setting.default),
        "minimum": about.minimum if about.minimum is not None else about.above,
        "maximum": about.maximum,
        "example": "",
    }


def _fits(setting: Setting) -> bool:
    """Return whether a setting accepts text or a number; weights, which are a file, do not."""
    return bool(setting.choices) or any(kind in (int, float, str) for kind in setting.kinds)


def _names_a_file(setting: Setting, value: Any) -> bool:
    takes = any(kind is Path or getattr(kind, "__origin__", kind) is PathLike for kind in setting.kinds)
    return takes and isinstance(value, str) and value.strip().lower().endswith(ARRAY_FILES)


def _plain(given: Any) -> dict[str, Any]:
    """Return settings whose values are numbers or short texts."""
    if not isinstance(given, dict):
        raise ParameterError(f"settings are of type {type(given).__name__}; they must be an object of names and values")
    for name, value in given.items():
        known = isinstance(value, str | int | float | None) and not isinstance(value, bool)
        if not known or len(str(value)) > MOST_LETTERS:
            raise ParameterError("must be a number or a short text", parameter=str(name))
    return given


def _text(value: Any) -> str:
    return "" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
