"""Reports: one HTML file that shows meshes, their properties, what was done, and how to reproduce it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from cascadenorm.api.inspection import FINDINGS, Inspection, inspect
from cascadenorm.api.opened_files import Denoised, DenoisingSummary
from cascadenorm.errors import OutputError, ParameterError, counted
from cascadenorm.geometry.metrics import SYMBOLS, Measures, measure
from cascadenorm.io.atomic import check_output, write_atomically
from cascadenorm.mesh import Mesh, MeshError, one_blas_thread
from cascadenorm.registry import find
from cascadenorm.render import Camera, HeatMap, Panel, inline_row, render
from cascadenorm.reports import facts
from cascadenorm.reports.facts import InspectedMeshes, MeasuredMeshes
from cascadenorm.reports.given import Given, given, scaled_meshes
from cascadenorm.reports.page import code, folded, html_list, page, table
from cascadenorm.reports.places import DefectPlace, places
from cascadenorm.reports.scene import viewer_scene

PICTURE = 560  # width and height of each picture of a mesh, in pixels


class Contents(NamedTuple):
    """The inspections of a report, and errors against the truth, if any, by mesh: "mesh", or "before" and "after"."""

    inspections: dict[str, Inspection]
    measures: dict[str, Measures]


def check_report(output: str | PathLike[str], *, force: bool) -> Path:
    """Return the path of a report; raise the errors of `report` before any work."""
    if not isinstance(output, str | PathLike):
        raise ParameterError(
            f"is of type {type(output).__name__}; the path of the report comes before the meshes", parameter="output"
        )
    path = Path(output)
    if path.suffix.lower() not in (".html", ".htm"):
        raise OutputError(f"{path} is not the name of an HTML file: end it in .html")
    check_output(path, force=force)
    return path


@one_blas_thread()  # further threads would spin while they wait for work
def report(
    output: str | PathLike[str],
    mesh: Any,
    result: Any = None,
    *,
    truth: Any = None,
    summary: DenoisingSummary | None = None,
    self_intersections: bool | None = None,
    force: bool = False,
) -> Contents:
    """Write a report on a mesh, its denoised version, and the errors of both against the truth.

    It is one self-contained HTML file: meshes in a 3-D viewer, heat maps, findings, and, with `summary`, how to
    reproduce the result. Without scripts or WebGL it shows text and a picture.

    Parameters
    ----------
    output
        HTML file.
    mesh
        Mesh of any kind that `denoise` accepts. A single file is shown without its invalid vertices and faces. If
        it has no valid face, the report is text only.
    result
        The denoised mesh.
    truth
        The true mesh.
    summary
        Summary that `denoise_file` returned for `result`.
    self_intersections
        Whether to look for faces that cross each other, as in `inspect`.
    force
        Replace an existing file.

    Returns
    -------
    The inspections and measures, as `inspect` and `compare` return them.

    Raises
    ------
    ReadError, MeshError
        A mesh cannot be read or drawn, or is invalid.
    ParameterError
        `output` is not a path.
    OutputError
        The file has no extension of HTML, exists although force is not given, or cannot be written.
    """
    output = check_report(output, force=force)
    judged = [given("mesh" if result is None else "before", mesh)]
    if result is not None:
        judged.append(given("after", result))
    shown = judged if truth is None else [*judged, given("truth", truth)]
    if len(shown) == 1:
        shown = judged = [judged[0]._replace(file=judged[0].file.isolating())]
    inspected = [
        (one, replace(inspect(one.file, self_intersections=self_intersections), source=one.name)) for one in judged
    ]
    measured = [] if truth is None else [(one, measure(one.mesh, shown[-1].mesh)) for one in judged]
    text = report_html(shown, inspected, measured, summary)
    write_atomically(output, [text.encode(errors="replace")], force=force)  # not every file name is valid Unicode
    return Contents({one.key: found for one, found in inspected}, {one.key: found for one, found in measured})


def report_denoised(
    output: str | PathLike[str], denoised: Denoised, *, truth: Any = None, force: bool = False
) -> Contents:
    """Write a report on the result of `denoise_file_with_meshes`."""
    summary = denoised.summary
    shown = Given("before", summary.source, denoised.before), Given("after", summary.output, denoised.after)
    return report(output, *shown, truth=truth, summary=summary, force=force)


def report_html(
    shown: Sequence[Given], inspected: InspectedMeshes, measured: MeasuredMeshes, done: DenoisingSummary | None
) -> str:
    """Return the page of a report."""
    found = [place for one, inspection in inspected for place in places(one, inspection)]
    sections = _sections(shown, inspected, measured, done, found)
    names = ", ".join(f"{one.label.lower()}: {one.name}" for one in shown)
    caption = names[0].upper() + names[1:]
    title = f"{Path(shown[0].name).name} – {'denoised' if done else 'mesh report'}"
    why = _undrawn(shown[0]) if len(shown) == 1 else None
    if why is not None:
        return page(title, [f"There is nothing to show: {why}."], sections)
    meshes = scaled_meshes(shown)  # their normals are used several times
    return page(
        title,
        facts.headline(inspected, done),
        sections,
        tiles=facts.key_figures(inspected, measured, done, meshes),
        picture=inline_row(drawn(shown, meshes, PICTURE), caption),
        caption=caption,
        scene=viewer_scene(shown, found, meshes=meshes),
    )


def _sections(
    shown: Sequence[Given],
    inspected: InspectedMeshes,
    measured: MeasuredMeshes,
    done: DenoisingSummary | None,
    found: Sequence[DefectPlace],
) -> list[tuple[str, str]]:
    """Return the titles and the HTML of what stands below the viewer."""
    warnings = facts.warnings(done, inspected)
    sections = [("Warnings", html_list(warnings))] if warnings else []
    if measured:
        measures = table(facts.columns([(one.label, errors.formatted()) for one, errors in measured]), numbers=True)
        sections.append(("Errors against the truth", f"<p>{escape(SYMBOLS)}</p>{measures}"))
    sections.append(("Findings", "".join(_findings(*one, len(inspected) > 1, found) for one in inspected)))
    sections.append(
        ("Shape", table(facts.columns([(one.label, facts.shape(inspection)) for one, inspection in inspected])))
    )
    if done is not None:
        sections.append(("Method and settings", _settings(done)))
    if done is not None and all(Path(name).is_file() for name in (done.source, done.output)):  # no streams
        sections.append(("Reproduce", code(facts.command_line(done)) + code(facts.python_call(done))))
    files = table(facts.file_rows(shown), stacked=True)
    sections.append(("Files", files + folded("Versions", table(facts.version_rows(done), head=False))))
    return sections


def _settings(done: DenoisingSummary) -> str:
    """Return what the method is, the settings that were changed, and below a fold the others."""
    method, (changed, usual) = find(done.method), facts.settings(done)
    about = f"<p>{escape(method.name)}: {escape(method.summary)} Source: {escape(method.source)}.</p>"
    title = counted(len(usual) - 1, "setting has its default", "settings have their defaults")
    shown = table(changed, prose=True) if changed[1:] else ""
    return about + shown + folded(title, table(usual, prose=True))


def _undrawn(alone: Given) -> str | None:
    """Return why a mesh has no surface that can be drawn; None where it has one."""
    if not len(alone.file.polygons):
        return f"{alone.name} has no faces"
    try:
        alone.mesh  # noqa: B018 - checked when it is first asked for
    except MeshError as error:
        return error.problem
    return None


def _findings(one: Given, found: Inspection, named: bool, listed_places: Sequence[DefectPlace]) -> str:
    """Return the defects of a mesh with their first places, which the viewer turns into buttons."""
    rows = []
    for name, finding in found.findings.items():
        there = [
            f'<li data-place="{number}">{escape(place.label)}</li>'
            for number, place in enumerate(listed_places)
            if (place.mesh, place.finding) == (one.key, name)
        ]
        more = "<li>…</li>" if finding.count > len(finding.first) else ""
        sentence = escape(counted(finding.count, *FINDINGS[name]))
        rows.append(f'<dt>{sentence}</dt><dd><ul class="places">{"".join(there)}{more}</ul></dd>')
    title = f"<h3>{escape(one.label)}</h3>" if named else ""
    return title + (f"<dl>{''.join(rows)}</dl>" if rows else "<p>No defects.</p>")


def drawn(
    shown: Sequence[Given], meshes: Mapping[str, Mesh], size: int, heat: Mapping[str, HeatMap] = MappingProxyType({})
) -> list[Panel]:
    """Draw meshes, those of `scaled_meshes`, from the best view of the last; some with values as colours, by key."""
    view = Camera.looking_at(meshes[shown[-1].key])
    style: dict[str, Any] = {"view": view, "size": (size, size), "transparent": True}
    return [Panel(render(meshes[one.key], values=heat.get(one.key), **style), one.label) for one in shown]
