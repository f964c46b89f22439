"""A report: one file of HTML that shows meshes, and says what they are, what was done, and how to do it again."""

from collections.abc import Sequence
from dataclasses import replace
from html import escape
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

from cascadenorm.api.opened_files import Denoised, DenoisingSummary
from cascadenorm.errors import counted
from cascadenorm.geometry.metrics import Measures, measure
from cascadenorm.inspection import FINDINGS, Inspection, inspect
from cascadenorm.io.atomic import check_output, write_atomically
from cascadenorm.mesh import MeshError, scaled_alike
from cascadenorm.registry import find
from cascadenorm.render import Camera, Panel, inline_svg, montage, render
from cascadenorm.reports import facts
from cascadenorm.reports.given import Given, given
from cascadenorm.reports.page import code, listed, page, plain_page, table
from cascadenorm.reports.places import Place, places
from cascadenorm.reports.scene import scene

Inspected = Sequence[tuple[Given, Inspection]]
Measured = Sequence[tuple[Given, Measures]]
PICTURE = (560, 560)
"""Size of each picture of a mesh, in pixels."""


class Contents(NamedTuple):
    """What a report says, by the meshes that it is about: "mesh", or "before" and "after".

    Parameters
    ----------
    inspections
        What each mesh is and what is wrong with it.
    measures
        How far each is from the truth; empty without one.
    """

    inspections: dict[str, Inspection]
    measures: dict[str, Measures]


def check_report(output: str | PathLike[str], *, force: bool) -> Path:
    """Return where a report is written; raises what `report` does where it cannot be."""
    check_output(Path(output), force=force)
    return Path(output)


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
    """Write a report on a mesh, on what was made of it, and on how far both are from the truth.

    It is one self-contained HTML file: meshes in a 3-D viewer, heat maps, findings, and, with `summary`, how to
    reproduce the result. Without scripts or WebGL it shows text and a picture.

    Parameters
    ----------
    output
        HTML file.
    mesh
        Of any kind that `denoise` takes; where it is alone, bad vertices and faces are left out of the view, and one
        without a usable face has a report in text.
    result
        The denoised mesh.
    truth
        The true mesh.
    summary
        What `denoise_file` returned for `result`.
    self_intersections
        Whether to look for faces that cross each other, as in `inspect`.
    force
        Replace an existing file.

    Returns
    -------
    What was found, as `inspect` and `compare` return it

    Raises
    ------
    ReadError, MeshError
        A mesh that cannot be read or drawn, or no mesh.
    OutputError
        The file exists and force is not given, or it cannot be written.
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
    write_atomically(output, [written(shown, inspected, measured, summary).encode()], force=force)
    return Contents({one.key: found for one, found in inspected}, {one.key: found for one, found in measured})


def report_denoised(
    output: str | PathLike[str], denoised: Denoised, *, truth: Any = None, force: bool = False
) -> Contents:
    """Write a report on what `denoised_file` did."""
    summary, before, after = denoised
    shown = Given("before", summary.source, before), Given("after", summary.output, after)
    return report(output, *shown, truth=truth, summary=summary, force=force)


def written(shown: Sequence[Given], inspected: Inspected, measured: Measured, done: DenoisingSummary | None) -> str:
    """Return the page of a report."""
    found = [place for one, inspection in inspected for place in places(one, inspection)]
    warnings = facts.warnings(done, inspected)
    sections = [("Warnings", listed(warnings))] if warnings else []
    if measured:
        sections.append(("Errors against the truth", table(facts.measure_rows(measured))))
    sections.append(("Shape", table(facts.shape_rows(inspected))))
    sections.append(("Findings", "".join(_findings(*one, len(inspected) > 1, found) for one in inspected)))
    if done is not None:
        method = find(done.method)
        about = f"<p>{escape(method.name)}: {escape(method.summary)} Source: {escape(method.source)}.</p>"
        sections.append(("Method and settings", about + table(facts.setting_rows(done), prose=True)))
        again = code(facts.command_line(done)) + code(facts.python_call(done))
        sections.append(("Reproduce", again))
    sections.append(("Files", table(facts.file_rows(shown))))
    sections.append(("Versions", table(facts.version_rows(done), head=False)))
    names = ", ".join(f"{one.label.lower()}: {one.name}" for one in shown)
    caption = names[0].upper() + names[1:]
    title = f"{Path(shown[0].name).name} – {'denoised' if done else 'mesh report'}"
    summary = _summary(inspected, measured, done)
    why = _undrawn(shown[0]) if len(shown) == 1 else None
    if why is not None:
        return plain_page(title, [f"There is nothing to show: {why}.", *summary], sections)
    return page(
        title,
        summary,
        sections,
        picture=_picture(shown, caption),
        caption=caption,
        scene=scene(shown, found),
    )


def _undrawn(alone: Given) -> str | None:
    """Why a mesh has no surface that can be drawn; None where it has one."""
    if not len(alone.file.polygons):
        return f"{alone.name} has no faces"
    try:
        alone.mesh  # noqa: B018 - checked when it is first asked for
    except MeshError as error:
        return error.problem
    return None


def _summary(inspected: Inspected, measured: Measured, done: DenoisingSummary | None) -> list[str]:
    """What matters most, in a sentence each."""
    said = []
    if done is not None:
        said.append(
            f"{done.method} moved {done.moved:,} of {done.vertices:,} vertices by "
            f"{done.mean_displacement:.3g} mean edge lengths on average and {done.largest_displacement:.3g} at most, "
            f"in {done.seconds:.1f} s."
        )
    if measured:
        errors = [f"{one.label.lower()} {measures.normal_error_deg:.2f}°" for one, measures in measured]
        said.append(f"Mean angle between the normals and the true ones: {', '.join(errors)}.")
    for one, found in inspected:
        noise = "noise unknown" if found.noise is None else f"noise of about {found.noise:.2g} mean edge lengths"
        kinds = counted(len(found.findings), "kind of defect", "kinds of defects") if found.findings else "no defects"
        said.append(f"{one.label}: {found.faces:,} {'face' if found.faces == 1 else 'faces'}, {noise}, {kinds}.")
    return said


def _findings(one: Given, found: Inspection, named: bool, listed_places: Sequence[Place]) -> str:
    """The defects of a mesh, each with the places that are known; the viewer makes buttons of them."""
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


def _picture(shown: Sequence[Given], about: str) -> str:
    """All meshes side by side, from where the last is seen well."""
    meshes = scaled_alike(*(one.mesh for one in shown))
    view = Camera.looking_at(meshes[-1])
    drawn = [
        Panel(render(mesh, view=view, size=PICTURE, transparent=True), one.label)
        for one, mesh in zip(shown, meshes, strict=True)
    ]
    return inline_svg(montage([drawn]), about)
