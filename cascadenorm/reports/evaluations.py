"""Evaluations as HTML: one page with tables and figures, and a page with the viewer for each pair."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from os import PathLike, fsencode
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.errors import CascadenormError, ParameterError
from cascadenorm.evaluation import tables
from cascadenorm.evaluation.harness import Evaluation, RunResult
from cascadenorm.evaluation.runs import NOISY
from cascadenorm.execution.progress import Progress, no_progress
from cascadenorm.geometry.metrics import SYMBOLS, errors
from cascadenorm.io.atomic import make_folder, write_atomically
from cascadenorm.io.interop import as_mesh
from cascadenorm.io.pairs import FilePair
from cascadenorm.mesh import Mesh, scaled_alike
from cascadenorm.render import Camera, inline_svg, montage
from cascadenorm.render.camera import MARGIN, projected
from cascadenorm.render.scenes import Style, color_bar, one_view, panels, scene
from cascadenorm.render.style import ACCENTS, INK, drawing
from cascadenorm.reports.given import given
from cascadenorm.reports.page import Tile, image, page, table
from cascadenorm.reports.scene import viewer_scene
from cascadenorm.reports.writing import check_report

ROW_WIDTH = 1640  # width of a row of pictures in pixels; the more pictures it has, the smaller they are
LARGEST_PICTURE, SMALLEST_PICTURE = 420, 160
OVERVIEW = "Mean angle by method"
CROP = 0.22  # width of the enlarged part as a fraction of the picture
QUANTILES = {"whislo": 0.05, "q1": 0.25, "med": 0.5, "q3": 0.75, "whishi": 0.95}
"""Ends of the whiskers and of the box, and the line in it, as matplotlib calls them."""
PLOT_WIDTH, ROW, BESIDES = 720, 30, 80
"""Pixels: width of a plot, height of a row, and height of title and axis together."""
FONT_SIZE = 13  # size of the text in pixels


class _Shown(NamedTuple):
    """The meshes of a pair by method with the errors of their faces, and the true mesh."""

    pair: FilePair
    results: list[RunResult]
    meshes: list[Mesh]
    clean: Mesh
    angles: list[NDArray[np.float64]]  # angle between each face normal and the true one; NaN where it is unknown


def check_evaluation(output: str | PathLike[str], *, force: bool) -> Path:
    """Return the folder of the pages of the pairs; raise the errors of `report_evaluation` before any work."""
    output = check_report(output, force=force)
    return output.with_name(f"{output.stem}_files")


def report_evaluation(
    output: str | PathLike[str], done: Evaluation, *, force: bool = False, progress: Progress = no_progress
) -> None:
    """Write an evaluation as an HTML page, and beside it a folder with a page for each pair.

    The folder has the name of the page, with `_files` instead of the extension. `progress` is called with (task, pairs
    done, total pairs, next pair). Raises ParameterError if the evaluation kept no meshes, as `evaluate` with `keep`
    does, and OutputError if the file exists and force is not given, or if it cannot be written.
    """
    folder = check_evaluation(output, force=force)
    if done.records is None:
        raise ParameterError("the meshes of the evaluation were not kept", hint="give evaluate a folder to keep them")
    make_folder(folder)
    failures = [(f.pair, f.method or "", _said(f.error)) for f in done.failures]
    sections = [("Failures", table([("pair", "method", "error"), *failures]))] if failures else []
    means = [
        (f"{one.method} *" if one.method in done.partial else one.method, one.measures.normal_error_deg)
        for one in done.means
    ]
    sections.append((OVERVIEW, bar_chart(means, unit="°")))
    of_pairs, *others = tables.all_tables(done)
    sections.append((f"Mean angle {of_pairs.title}", f"<p>{SYMBOLS}</p>{_table(of_pairs)}"))
    sections += [(one.title, _table(one)) for one in others]
    named = {pair.name: pair for pair in done.pairs}
    measured = list(dict.fromkeys(result.pair for result in done.results))
    for number, name in enumerate(measured):
        progress("writing", number, len(measured), name)
        shown = _shown(done, named[name])
        file = f"{done.records.mesh_file(name, 'any').parent.name}.html"
        title = f"{name} – evaluation"
        caption = f"Above: the meshes. Below: angle between the face normals of {name} and the true ones."
        picture, content = _figure(shown, caption), _pair_sections(shown)
        link = f'<p><a href="{quote(fsencode(f"{folder.name}/{file}"))}">Open {escape(name)} in the 3-D viewer</a></p>'
        parts = "".join(f"<h3>{escape(about)}</h3>{html}" for about, html in content)
        sections.append((name, image(picture, caption) + link + parts))
        whole = page(title, [], content, picture=picture, caption=caption, scene=_viewer(shown))
        write_atomically(folder / file, [whole.encode(errors="replace")], force=True)
    progress("writing", len(measured), len(measured))
    about = ["The best value of each row or column is in bold; – marks unknown values."]
    whole = page("Evaluation", about, sections, tiles=_tiles(done, len(measured)))
    write_atomically(Path(output), [whole.encode(errors="replace")], force=force)


def _said(error: Exception) -> str:
    """Return the message of an error, with its type if the error comes from the code of a method."""
    return str(error) if isinstance(error, CascadenormError) else f"{type(error).__name__}: {error}"


def _tiles(done: Evaluation, pairs: int) -> list[Tile]:
    """Return the key figures: the mean angle of the noisy meshes, the best mean angle, and the counts."""
    means = {one.method: one.measures.normal_error_deg for one in done.means}
    judged = {method: angle for method, angle in means.items() if method != NOISY and method not in done.partial}
    tiles = [Tile("Noisy", (f"{means[NOISY]:.2f}°",), "mean angle E_a")] if NOISY in means else []
    if judged:
        best = min(judged, key=judged.__getitem__)
        tiles.append(Tile(f"Best: {best}", (f"{judged[best]:.2f}°",), "mean angle E_a"))
    tiles += [Tile("Pairs", (f"{pairs:,}",)), Tile("Methods", (f"{len(done.methods) - (NOISY in done.methods):,}",))]
    return [*tiles, Tile("Failures", (f"{len(done.failures):,}",))] if done.failures else tiles


def _shown(done: Evaluation, pair: FilePair) -> _Shown:
    assert done.records is not None
    results = [result for result in done.results if result.pair == pair.name]
    meshes = [as_mesh(done.records.mesh_file(pair.name, result.method)) for result in results]
    clean = as_mesh(pair.clean)
    return _Shown(pair, results, meshes, clean, [errors(*scaled_alike(mesh, clean)).angles for mesh in meshes])


def _pair_sections(shown: _Shown) -> list[tuple[str, str]]:
    """Return the measures of a pair and the distribution of its errors."""
    rows = {one.method: found[~np.isnan(found)] for one, found in zip(shown.results, shown.angles, strict=True)}
    measured = tables.method_table(shown.results, "Measures")
    title = "Angles of all faces: median, quartiles, and 5th to 95th percentile"
    plot = box_plot(rows, title=title, label="angle between face normal and the true one (°)")
    return [("Measures", _table(measured)), ("Angle between the face normals and the true ones", plot)]


def _figure(shown: _Shown, about: str) -> str:
    """Return a picture of the meshes and the true mesh with an enlarged part; below, the errors on a common scale."""
    count = len(shown.meshes) + 1
    size = int(np.clip(ROW_WIDTH / count - 12, SMALLEST_PICTURE, LARGEST_PICTURE))
    names = [one.method for one in shown.results]
    camera = Camera.looking_at(shown.clean)
    style = Style(size=size, direction=camera.axes[2], crops=[_worst_part(shown, camera)], transparent=True)
    above = scene([*shown.meshes, shown.clean], [*names, "truth"], style)
    heat = replace(style, crops=(), values="normal-error", reference=shown.clean)
    below = scene(shown.meshes, names, heat)
    views = one_view(above)
    return inline_svg(montage([panels(above, views), panels(below, views[:-1])], bar=color_bar(below)), about)


def _worst_part(shown: _Shown, camera: Camera) -> tuple[float, float, float]:
    """Return the part of the picture with the largest error, summed over the visible faces of all methods."""
    cells = int(1 / CROP * 2)
    total = np.zeros((cells, cells))
    measured = list(zip(shown.meshes, shown.angles, strict=True))
    half = MARGIN * max(camera.reach)
    for mesh, angles in measured[1:] or measured:
        facing = mesh.face_normals @ camera.axes[2] > 0.2
        x, y = (projected(camera.framed(mesh.centroids), camera.perspective)[:, :2] / half).T
        places = [np.clip(((1 + along) / 2 * cells).astype(int), 0, cells - 1) for along in (x, -y)]
        weights = np.where(facing, np.nan_to_num(angles) * mesh.areas / max(mesh.areas.sum(), 1e-300), 0.0)
        np.add.at(total, (places[1], places[0]), weights)
    row, column = np.unravel_index(int(total.argmax()), total.shape)
    x, y = (float(np.clip((place + 0.5) / cells, CROP / 2, 1 - CROP / 2)) for place in (column, row))
    return x, y, CROP


def _viewer(shown: _Shown) -> Mapping[str, object]:
    """Return the scene with all meshes of the pair, the true mesh last."""
    meshes = [
        given(one.method, mesh)._replace(name=one.method) for one, mesh in zip(shown.results, shown.meshes, strict=True)
    ]
    truth = given("truth", shown.clean)._replace(name=str(shown.pair.clean))
    return viewer_scene([*meshes, truth], [])


def _table(one: tables.Table) -> str:
    """Return a table with its best cells in bold; the head is row 0."""
    best = {(i, j) for i, row in enumerate(one.rows, start=1) for j, cell in enumerate(row) if cell.best}
    return table([one.head, *[[cell.text for cell in row] for row in one.rows]], bold=best, numbers=True)


def bar_chart(rows: Sequence[tuple[str, float]], *, unit: str) -> str:
    """Return a bar for each name and value, at least 0, with its unit; the lowest first and in the accent colour."""
    lowest, largest = (found((value for _, value in rows), default=0.0) for found in (min, max))
    bars = []
    for name, value in sorted(rows, key=lambda row: row[1]):
        kind = ' class="best"' if value == lowest else ""
        bar = f'<dd><i{kind} style="width: {100 * value / (largest or 1.0):.1f}%"></i></dd>'
        bars.append(f"<dt>{escape(name)}</dt>{bar}<dd>{value:.2f}{escape(unit)}</dd>")
    return f'<dl class="bars-of">{"".join(bars)}</dl>'


def box_plot(rows: Mapping[str, ArrayLike], *, title: str, label: str) -> str:
    """Draw the distribution of values, one row each: boxes span the quartiles, whiskers the 5th to 95th percentile.

    `rows` has the values, at least one, of each name. The label is the name and unit of the values.
    """
    boxes = [
        {name: float(np.quantile(np.asarray(values), share)) for name, share in QUANTILES.items()}
        for values in rows.values()
    ]
    medians = [f"{name}: median {box['med']:.2f}" for name, box in zip(rows, boxes, strict=True)]
    names = [name.replace("\n", " ") for name in rows]
    with drawing("".join([*names, title, label])):
        from matplotlib.figure import Figure

        size = PLOT_WIDTH / 72, (BESIDES + ROW * len(names)) / 72
        figure = Figure(size, dpi=72, layout="constrained")  # a point is a pixel
        axes = figure.subplots()
        axes.bxp(
            boxes,
            positions=range(len(boxes)),
            widths=0.5,
            orientation="horizontal",
            showfliers=False,
            showcaps=False,
            patch_artist=True,
            boxprops={"facecolor": INK, "alpha": 0.35, "linewidth": 0},
            whiskerprops={"color": INK},
            medianprops={"color": ACCENTS[0], "linewidth": 2.5},
        )
        axes.set_title(title, size=FONT_SIZE, loc="left")
        axes.set_xlabel(label, size=FONT_SIZE)
        axes.set_yticks(range(len(names)), names)
        axes.tick_params(labelsize=FONT_SIZE, length=0)
        axes.set(xlim=(0, None), ylim=(len(names) - 0.5, -0.5))
        axes.grid(axis="x", color=INK, alpha=0.2)
        axes.spines[:].set_visible(False)
        axes.patch.set_visible(False)
    return inline_svg(figure, f"{title}. {'; '.join(medians)}")
