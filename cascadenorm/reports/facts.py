"""Key figures and tables of a report: files, shape, settings, versions, and commands that reproduce the result."""

import platform
import shlex
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cascadenorm.api.api import weights_digest
from cascadenorm.api.inspection import Inspection
from cascadenorm.api.inspection.source import Found
from cascadenorm.api.opened_files import DenoisingSummary
from cascadenorm.errors import counted
from cascadenorm.geometry.metrics import Measures, angles_at_faces
from cascadenorm.mesh import Mesh
from cascadenorm.registry import find
from cascadenorm.registry.controls import CONTROLS
from cascadenorm.reports.given import Given
from cascadenorm.reports.page import Tile
from cascadenorm.version import __version__

Rows = list[tuple[str, ...]]
InspectedMeshes = Sequence[tuple[Given, Inspection]]
MeasuredMeshes = Sequence[tuple[Given, Measures]]

LIBRARIES = ("numpy", "scipy", "numba")  # packages whose versions may change the last digits of a result


def key_figures(
    inspected: InspectedMeshes, measured: MeasuredMeshes, done: DenoisingSummary | None, meshes: Mapping[str, Mesh]
) -> list[Tile]:
    """Return the tiles at the top of a report; values of two meshes are shown as before → after.

    `meshes` are the shown meshes by key, as `scaled_meshes` returns them.
    """
    found = [inspection for _, inspection in inspected]
    noise = ("unknown" if one.noise is None else f"{one.noise:.2g}" for one in found)
    folded = "\N{NO-BREAK SPACE}→\N{NO-BREAK SPACE}".join(f"{one.folded_edges:,}" for one in found)
    if done is not None:
        note = f"mean edge lengths on average, {done.largest_displacement:.3g} at most"
        last = Tile("Displacement", (f"{done.mean_displacement:.3g}",), note)
    else:
        vertices = "vertex" if found[-1].vertices == 1 else "vertices"
        last = Tile("Faces", (f"{found[-1].faces:,}",), f"{found[-1].vertices:,} {vertices}")
    return [
        Tile("Noise", tuple(noise), "mean edge lengths"),
        *_angle(meshes, measured),
        _volume(found),
        Tile("Self-intersecting faces", tuple(count_of(one.crossing_faces) for one in found)),
        Tile("Spikes", tuple(count_of(one.spikes) for one in found), f"vertices; folded edges: {folded}"),
        last,
    ]


def headline(inspected: InspectedMeshes, done: DenoisingSummary | None) -> list[str]:
    """Return the kind of error and of surface of the first mesh, and the method, worded as by `denoise`."""
    known = inspected[0][1] if done is None else done
    parts = {"Kind of error": known.error, "Treated as": known.treated_as}
    method = {} if done is None else {"Method": f"{done.method}, {done.seconds:.1f} s"}
    line = " ".join(f"{name}: {value}." for name, value in {**parts, **method}.items() if value is not None)
    return [line] if line else []


def _angle(meshes: Mapping[str, Mesh], measured: MeasuredMeshes) -> list[Tile]:
    """Return the mean angle to the truth, or to the input if there is no truth."""
    if measured:
        values = tuple(f"{measures.normal_error_deg:.2f}°" for _, measures in measured)
        return [Tile("Angle to the truth", values, "mean over the faces")]
    if len(meshes) < 2 or not np.array_equal(meshes["before"].faces, meshes["after"].faces):
        return []
    angles = angles_at_faces(meshes["after"].face_normals, meshes["before"].face_normals)
    known = angles[~np.isnan(angles)]
    value = f"{known.mean():.2f}°" if len(known) else "unknown"
    return [Tile("Angle to the input", (value,), "mean over the faces")]


def _volume(found: Sequence[Inspection]) -> Tile:
    volumes = [one.volume for one in found]
    known = [volume for volume in volumes if volume is not None]
    if len(known) < len(volumes):
        loops = found[-1].boundary_loops
        note = f"open, {counted(loops, 'boundary loop')}" if loops else "not an oriented manifold"
        return Tile("Volume", ("none",), note)
    if len(known) == 2 and known[0]:
        change = 100 * (known[1] / known[0] - 1)
        return Tile("Volume", (f"{change:+.2f} %".replace("-", "−"),), f"{known[0]:.5g} → {known[1]:.5g} mesh units³")
    return Tile("Volume", (f"{known[-1]:.5g}",), "mesh units³")


def file_rows(shown: Sequence[Given]) -> Rows:
    """Return the name, size and checksum of each file."""
    rows: Rows = [("", "file", "bytes", "SHA-256")]
    for given in shown:
        size, digest = given.checksum() or (None, "in memory" if not given.from_file else "written to a stream")
        rows.append((given.label, given.name, f"{size:,}" if size is not None else "", digest))
    return rows


def columns(named: Sequence[tuple[str, Mapping[str, str]]]) -> Rows:
    """Return a table with a column for each label and its named values."""
    rows = [(name, *(values[name] for _, values in named)) for name in named[0][1]]
    return [("", *(label for label, _ in named)), *rows]


def shape(found: Inspection) -> dict[str, str]:
    """Return the properties of a mesh by their names."""
    return {
        "vertices": f"{found.vertices:,}",
        "faces": f"{found.faces:,}",
        "connected components": f"{found.parts:,}",
        "surface": "closed" if found.closed else f"open, {counted(found.boundary_loops, 'boundary loop')}",
        "self-intersecting faces": count_of(found.crossing_faces),
        "spikes": count_of(found.spikes),
        "outliers": count_of(found.outliers),
        "edges folded by more than 90°": f"{found.folded_edges:,}",
        "small components": count_of(found.small_components),
        "genus": "none" if found.genus is None else str(found.genus),
        "mean edge length (mesh units)": _number(found.mean_edge_length),
        "area (mesh units²)": _number(found.area),
        "enclosed volume (mesh units³)": _number(found.volume),
        "noise along the normal (mean edge lengths)": "unknown" if found.noise is None else f"{found.noise:.2g}",
        "kind of error": "not determined" if found.error is None else str(found.error),
        "treated as": "" if found.treated_as is None else str(found.treated_as),
    }


def settings(done: DenoisingSummary) -> tuple[Rows, Rows]:
    """Return the parameters and controls that differ from their defaults, and the others, both below a head."""
    head = ("", "value", "default", "meaning")
    changed: Rows = [head]
    usual: Rows = [head]
    listed = [(one, done.parameters.get(one.name, one.default)) for one in find(done.method).given_by_name]
    listed += [(CONTROLS[name], value) for name, value in {"strength": done.strength, **done.controls}.items()]
    for setting, value in listed:
        row = (setting.name, _setting(value), _setting(setting.default), setting.about.help)
        (usual if value == setting.default else changed).append(row)
    return changed, usual


def version_rows(done: DenoisingSummary | None) -> Rows:
    """Return what the result depends on besides files and settings."""
    rows: Rows = [("cascadenorm", __version__), ("Python", platform.python_version())]
    rows += [(name, version(name)) for name in LIBRARIES]
    if done is not None:
        rows.append(("seed", "none; no random numbers are used, and the number of threads has no effect"))
        if weights := weights_digest(done.method, done.parameters):
            rows.append((f"weights of {done.method}", f"SHA-256 {weights}"))
    return rows


class Recipe(NamedTuple):
    """Names and settings that reproduce a file, with arrays named by their files."""

    source: str
    output: str
    method: str
    parameters: dict[str, Any]
    strength: float
    controls: dict[str, Any]
    weld: float | str | None = None
    drop_components: str | int | None = None


def command_line(done: DenoisingSummary | Recipe) -> str:
    """Return the command that reproduces the file."""
    source = f"./{done.source}" if done.source.startswith("-") else done.source  # otherwise it is taken for an option
    words = ["cascadenorm", "denoise", source, "-o", done.output, "--method", done.method]
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
    words += ["--weld", str(done.weld)] if done.weld is not None else []
    words += ["--drop-components", str(done.drop_components)] if done.drop_components is not None else []
    return shlex.join(words)


def python_call(done: DenoisingSummary | Recipe) -> str:
    """Return the Python call that reproduces the file."""
    controls = {"strength": done.strength, **done.controls}
    settings: dict[str, Any] = {name: v for name, v in controls.items() if v != CONTROLS[name].default}
    opening = {"weld": done.weld, "drop_components": done.drop_components}
    settings |= {name: value for name, value in opening.items() if value is not None}
    arguments = [repr(done.source), repr(done.output), f"method={done.method!r}"]
    if done.parameters:
        plain = {name: str(value) if isinstance(value, Path) else value for name, value in done.parameters.items()}
        arguments.append(f"parameters={plain!r}")
    arguments += [f"{name}={value!r}" for name, value in settings.items()]
    return f"import cascadenorm as cn\n\ncn.denoise_file({', '.join(arguments)})"


def warnings(done: DenoisingSummary | None, inspected: InspectedMeshes) -> list[str]:
    """Return sentences that a reader should know before using the result."""
    said = []
    if done is not None:
        said += [f"left out of the output: {loss}" for loss in done.left_out]
        said += [f"left unchanged: {done.left_unchanged}"] if done.left_unchanged else []
        said += [done.volume_not_kept] if done.volume_not_kept else []
        said += [done.remedies] if done.remedies else []
    for given, found in inspected:
        if found.crossing_faces is None:
            said.append(f"{given.label}: self-intersections were not checked, because the mesh is large")
    return said


def count_of(found: Found | None) -> str:
    """Return the number of places of a finding."""
    return "not checked" if found is None else f"{found.count:,}"


def _setting(value: object) -> str:
    return "none" if value is None else str(value)


def _number(value: float | None) -> str:
    return "none" if value is None else f"{value:.6g}"
