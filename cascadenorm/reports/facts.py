"""What a report says besides what it shows: files, measures, findings, and how to make the result again."""

import platform
import shlex
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol

from cascadenorm.api.opened_files import DenoisingSummary
from cascadenorm.controls import CONTROLS
from cascadenorm.errors import counted
from cascadenorm.geometry.metrics import Measures
from cascadenorm.inspection import Inspection
from cascadenorm.inspection.source import Found
from cascadenorm.io.digests import file_digest
from cascadenorm.learned.methods import weights_file
from cascadenorm.registry import find
from cascadenorm.reports.given import Given
from cascadenorm.version import __version__

Rows = list[tuple[str, ...]]

LIBRARIES = ("numpy", "scipy", "numba")
"""Packages whose version may change the last digits of a result."""


def file_rows(shown: Sequence[Given]) -> Rows:
    """Name, size and checksum of each file."""
    rows: Rows = [("", "file", "bytes", "SHA-256")]
    for given in shown:
        size, digest = given.checksum() or (None, "in memory" if not given.from_file else "written to a stream")
        rows.append((given.label, given.name, f"{size:,}" if size is not None else "", digest))
    return rows


def shape_rows(inspected: Sequence[tuple[Given, Inspection]]) -> Rows:
    """What each mesh is, a column a mesh."""
    columns = [_shape(found) for _, found in inspected]
    head = ("", *(given.label for given, _ in inspected))
    return [head, *((name, *(column[name] for column in columns)) for name in columns[0])]


def _shape(found: Inspection) -> dict[str, str]:
    return {
        "vertices": f"{found.vertices:,}",
        "faces": f"{found.faces:,}",
        "connected components": f"{found.parts:,}",
        "surface": "closed" if found.closed else f"open, {counted(found.boundary_loops, 'boundary loop')}",
        "self-intersecting faces": _counted(found.crossing_faces),
        "spikes": _counted(found.spikes),
        "small components": _counted(found.small_components),
        "genus": "none" if found.genus is None else str(found.genus),
        "mean edge length": _number(found.mean_edge_length),
        "area": _number(found.area),
        "enclosed volume": _number(found.volume),
        "noise along the normal": "unknown" if found.noise is None else f"{found.noise:.2g} mean edge lengths",
        "kind of error": "not determined for so many faces" if found.error is None else str(found.error),
        "treated as": "" if found.treated_as is None else str(found.treated_as),
    }


def measure_rows(measured: Sequence[tuple[Given, Measures]]) -> Rows:
    """Errors against the truth, a column a mesh."""
    words = [measures.in_words() for _, measures in measured]
    head = ("", *(given.label for given, _ in measured))
    return [head, *((name, *(of[name] for of in words)) for name in (words[0] if words else ()))]


def setting_rows(done: DenoisingSummary) -> Rows:
    """Every parameter of the method and every control, with its value and whether it was given."""
    rows: Rows = [("", "value", "default", "meaning")]
    for parameter in find(done.method).given_by_name:
        value = done.parameters.get(parameter.name, parameter.default)
        rows.append((parameter.name, _setting(value), _setting(parameter.default), parameter.about.help))
    given = {"strength": done.strength, **done.controls}
    for name, value in given.items():
        rows.append((name, _setting(value), _setting(CONTROLS[name].default), CONTROLS[name].about.help))
    return rows


def version_rows(done: DenoisingSummary | None) -> Rows:
    """What the result depends on besides files and settings."""
    rows: Rows = [("cascadenorm", __version__), ("Python", platform.python_version())]
    rows += [(name, version(name)) for name in LIBRARIES]
    if done is not None:
        rows.append(("seed", "none: no random numbers are drawn, and the number of threads changes nothing"))
        weights = _weights(done)
        if weights is not None:
            rows.append((f"weights of {done.method}", f"SHA-256 {file_digest(weights)}"))
    return rows


class Recipe(Protocol):
    """What makes a file, as in `DenoisingSummary`."""

    @property
    def source(self) -> str: ...
    @property
    def output(self) -> str: ...
    @property
    def method(self) -> str: ...
    @property
    def parameters(self) -> dict[str, Any]: ...
    @property
    def strength(self) -> float: ...
    @property
    def controls(self) -> dict[str, Any]: ...


def command_line(done: Recipe) -> str:
    """Return the command that makes the same file again."""
    words = ["cascadenorm", "denoise", done.source, "-o", done.output, "--method", done.method]
    parameters = {name: value for name, value in done.parameters.items() if name != "model"}
    words += [word for name, value in parameters.items() for word in ("--set", f"{name}={value}")]
    if "model" in done.parameters:
        words += ["--model", str(done.parameters["model"])]
    for name, value in {"strength": done.strength, **done.controls}.items():
        control = CONTROLS[name]
        if value == control.default:
            continue
        for word in value if isinstance(value, list | tuple) else (value,):
            words += [control.option] if control.about.flag else [control.option, str(word)]
    return shlex.join(words)


def python_call(done: Recipe) -> str:
    """Return the call that makes the same file again."""
    controls = {"strength": done.strength, **done.controls}
    settings: dict[str, Any] = {name: v for name, v in controls.items() if v != CONTROLS[name].default}
    arguments = [repr(done.source), repr(done.output), f"method={done.method!r}"]
    if done.parameters:
        arguments.append(f"parameters={ {name: _plain(value) for name, value in done.parameters.items()}!r}")
    arguments += [f"{name}={value!r}" for name, value in settings.items()]
    return f"import cascadenorm as cn\n\ncn.denoise_file({', '.join(arguments)})"


def warnings(done: DenoisingSummary | None, inspected: Sequence[tuple[Given, Inspection]]) -> list[str]:
    """What a reader should know before using the result, in sentences."""
    said = [] if done is None else [f"left out of the output: {loss}" for loss in done.left_out]
    if done is not None and (done.isolated_vertices or done.isolated_faces):
        vertices = counted(done.isolated_vertices, "vertex that is not finite", "vertices that are not finite")
        said.append(f"left unchanged: {vertices}, {counted(done.isolated_faces, 'bad face')}")
    for given, found in inspected:
        if found.crossing_faces is None:
            said.append(f"{given.label}: self-intersections were not checked, because the mesh is large")
    return said


def _counted(found: Found | None) -> str:
    return "not checked" if found is None else f"{found.count:,}"


def _plain(value: Any) -> Any:
    return str(value) if isinstance(value, Path) else value


def _setting(value: object) -> str:
    return "none" if value is None else str(value)


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.6g}"


def _weights(done: DenoisingSummary) -> Path | None:
    """The weights file of a learned method."""
    if "model" not in find(done.method).settings:
        return None
    return weights_file(done.method, done.parameters.get("model"))
