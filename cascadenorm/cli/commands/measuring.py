"""Commands that measure meshes, and methods on them."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer

from cascadenorm.cli.app import app
from cascadenorm.cli.errors import PARTLY, complain, worded
from cascadenorm.cli.options import Force, Json, ReportFile, Set, named_values, parameter_values, takes_controls

if TYPE_CHECKING:
    from cascadenorm.evaluation.pairs import Pair


@app.command()
def compare(
    mesh: Annotated[str, typer.Argument(metavar="MESH", help="The mesh to judge, or - for stdin.")],
    reference: Annotated[str, typer.Argument(metavar="REFERENCE", help="The true mesh.")],
    *,
    report: ReportFile = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Measure a mesh against the true one."""
    from cascadenorm import api
    from cascadenorm.cli import json_output, tables

    judged = sys.stdin.buffer if mesh == "-" else mesh
    if report is None:
        measures = api.compare(judged, reference)
    else:
        from cascadenorm import reports

        measures = reports.report(report, judged, truth=reference, force=force).measures["mesh"]
    if as_json:
        json_output.print_json("compare", json_output.compared(mesh, reference, measures))
    else:
        tables.print_measures(measures)


@app.command()
def spectrum(
    mesh: Annotated[str, typer.Argument(metavar="MESH", help="Mesh file, or - for stdin.")],
    other: Annotated[str | None, typer.Argument(metavar="[OTHER]", help="Another one, to compare it with.")] = None,
    *,
    count: Annotated[int, typer.Option("-n", "--count", min=1, help="Eigenvalues.")] = 50,
    scale: Annotated[
        str, typer.Option(metavar="area|keep", help="Multiply them by the area, so that size does not matter, or not.")
    ] = "area",
    as_json: Json = False,
) -> None:
    """Print the lowest eigenvalues of the Laplacian of a mesh, its shape DNA, and its distance from that of another."""
    from cascadenorm import spectra
    from cascadenorm.cli import json_output, tables

    if scale not in ("area", "keep"):
        raise typer.BadParameter(f"--scale is {scale!r}; it must be area or keep")
    first, second = (sys.stdin.buffer if name == "-" else name for name in (mesh, other))
    found = spectra.spectrum(first, second, count=count, scale=cast(Literal["area", "keep"], scale))
    if as_json:
        json_output.print_json("spectrum", json_output.spectrum(mesh, other, found))
    else:
        tables.print_spectrum(found)


@app.command()
@takes_controls("strength", "threads")
def evaluate(
    folders: Annotated[
        list[Path] | None, typer.Argument(metavar="[DIR...]", help="Pairs, or folders of pairs.", show_default=False)
    ] = None,
    *,
    dataset: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="A public set, in the copy that --from names; `list` says where to get them."
        ),
    ] = None,
    copy: Annotated[
        Path | None,
        typer.Option("--from", metavar="DIR", help="Your copy of the public set: a clone, or what was unpacked."),
    ] = None,
    split: Annotated[
        str, typer.Option(metavar="test|train", help="Part of the public set, as its paper splits it.")
    ] = "test",
    noise: Annotated[
        float | None,
        typer.Option(
            metavar="LEVEL",
            help="Add Gaussian noise along the normals to clean.* in the place of noisy.*: standard deviation in mean "
            "edge lengths.",
        ),
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Noisy meshes of each clean one; the tables have the spread.")] = 1,
    method: Annotated[list[str] | None, typer.Option(help="May be given several times.")] = None,
    result: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=DIR", help="Meshes DIR/<pair>.* from another program as a row; may be given several times."
        ),
    ] = None,
    command: Annotated[
        list[str] | None,
        typer.Option(
            metavar="'NAME=PROG {in} {out}'",
            help="Run another program on each noisy mesh; {in.obj} and {out.obj} are files of that format. "
            "May be given several times.",
        ),
    ] = None,
    settings: Set = None,
    csv: Annotated[Path | None, typer.Option(metavar="FILE", help="Write all results to a file as well.")] = None,
    markdown: Annotated[Path | None, typer.Option(metavar="FILE", help="Write tables for a page.")] = None,
    latex: Annotated[Path | None, typer.Option(metavar="FILE", help="Write tables for a paper.")] = None,
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write tables, figures, and a page with a viewer for each pair.")
    ] = None,
    keep: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder for the denoised meshes; run again, what is there is not computed again. With --html it is a "
            "folder beside that file by default.",
        ),
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    force: Force = False,
    as_json: Json = False,
    **controls: Any,
) -> None:
    """Denoise pairs of noisy.* and clean.* by several methods, and measure the results, also of other programs."""
    from cascadenorm.cli import json_output, progress_bars, tables
    from cascadenorm.evaluation import harness
    from cascadenorm.evaluation import tables as texts
    from cascadenorm.io.atomic import check_output, write_atomically

    if dataset == "list":
        tables.print_public_sets()
        return
    places: list[Pair | Path] = [*_public_pairs(dataset, copy, split), *(folders or [])]
    if not places:
        raise typer.BadParameter("give folders of pairs, or --dataset NAME --from DIR")
    for path in filter(None, (csv, markdown, latex)):
        check_output(path, force=force)
    if html is not None:
        from cascadenorm.reports.evaluations import check_evaluation, report_evaluation

        keep = keep or check_evaluation(html, force=force)
    with progress_bars.progress_tasks() as progress:
        done = harness.evaluate(
            places,
            methods=method or harness.DEFAULT_METHODS,
            results=named_values("--result", result),
            commands=named_values("--command", command),
            parameters=parameter_values(settings),
            noise=noise,
            seeds=seeds,
            keep=keep,
            workers=workers,
            progress=progress,
            **controls,
        )
        if html is not None:
            report_evaluation(html, done, force=force, progress=progress)
    for measured in done.results:
        if not measured.same_faces:
            complain(f"{measured.pair}, {measured.method}: other faces than clean.*; compared with the nearest of them")
    for failure in done.failures:
        complain(f"{failure.pair}{f', {failure.method}' if failure.method else ''}: {worded(failure.error)}")
    if as_json:
        json_output.print_json("evaluate", json_output.evaluated(done))
    else:
        tables.print_evaluation(done)
    written = ((csv, texts.comma_separated(done)), (markdown, texts.markdown(texts.all_tables(done))))
    for target, text in (*written, (latex, texts.latex(texts.all_tables(done)))):
        if target is not None:
            write_atomically(target, [text.encode()], force=force)
    if done.failures:
        raise typer.Exit(PARTLY)


def _public_pairs(dataset: str | None, copy: Path | None, split: str) -> "list[Pair]":
    """Return the pairs of a public set, or none; without a copy say where to get one."""
    from cascadenorm.evaluation.public_sets import public_pairs, public_set

    if dataset is None:
        if copy is not None:
            raise typer.BadParameter("--from is the copy of a public set: name it by --dataset")
        return []
    if copy is None:
        raise typer.BadParameter(f"give your copy of {dataset} by --from DIR; get it: {public_set(dataset).place}")
    return public_pairs(dataset, copy, split=cast(Literal["train", "test"], split))


@app.command()
def methods(
    name: Annotated[str | None, typer.Argument(help="Show this method's parameters.")] = None, *, as_json: Json = False
) -> None:
    """List the methods, or the parameters of one."""
    from cascadenorm import api
    from cascadenorm.cli import json_output, tables
    from cascadenorm.registry import find

    known = api.methods()
    chosen = known if name is None else {name: find(name)}
    if as_json:
        json_output.print_json("methods", json_output.methods(chosen.values()))
    elif name is None:
        tables.print_methods(known)
    else:
        tables.print_method(chosen[name])
