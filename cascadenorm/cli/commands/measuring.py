"""Commands that measure meshes and evaluate methods."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer import Argument, Option

from cascadenorm.cli.errors import PARTLY, notify, worded
from cascadenorm.cli.options import (
    Force,
    JsonOption,
    ReportFile,
    Scheduler,
    Set,
    app,
    control_options,
    named_values,
    parameter_values,
)

if TYPE_CHECKING:
    from cascadenorm.evaluation.harness import Evaluation
    from cascadenorm.io.pairs import FilePair


@app.command()
def compare(
    mesh: Annotated[str, Argument(metavar="MESH", help="Mesh to measure, or - for standard input.")],
    reference: Annotated[str, Argument(metavar="REFERENCE", help="Ground truth mesh.")],
    *,
    report: ReportFile = None,
    force: Force = False,
    as_json: JsonOption = False,
) -> None:
    """Measure a mesh against its ground truth."""
    from cascadenorm.api import api
    from cascadenorm.cli import tables

    judged = sys.stdin.buffer if mesh == "-" else mesh
    if report is None:
        measures = api.compare(judged, reference)
    else:
        from cascadenorm import reports

        measures = reports.report(report, judged, truth=reference, force=force).measures["mesh"]
    if as_json:
        about = {"mesh": mesh, "reference": reference, "measures": asdict(measures)}
        tables.print_json("compare", about)
    else:
        tables.print_measures(measures)
        if report is not None:
            print(f"report: {report}")


@app.command()
def spectrum(
    mesh: Annotated[str, Argument(metavar="MESH", help="Mesh file, or - for standard input.")],
    other: Annotated[str | None, Argument(metavar="[OTHER]", help="Mesh to compare with.")] = None,
    *,
    count: Annotated[int, Option("-n", "--count", min=1, help="Number of eigenvalues, the lowest of which is 0.")] = 50,
    scale: Annotated[
        Literal["area", "keep"],
        Option(
            metavar="area|keep",
            help="With area, the eigenvalues are multiplied by the surface area and so do not depend on the scale of "
            "the mesh; with keep, they are not.",
        ),
    ] = "area",
    as_json: JsonOption = False,
) -> None:
    """Print the lowest Laplacian eigenvalues of a mesh (its Shape DNA) and the distance to those of another mesh."""
    from cascadenorm.api import spectra
    from cascadenorm.cli import tables

    first, second = (sys.stdin.buffer if name == "-" else name for name in (mesh, other))
    found = spectra.spectrum(first, second, count=count, scale=scale)
    if as_json:
        about = {"mesh": mesh, "other": other, "scale": found.scale, "distance": found.distance}
        values = [None if one is None else one.tolist() for one in (found.values, found.other)]
        tables.print_json("spectrum", about | dict(zip(("eigenvalues", "other_eigenvalues"), values, strict=True)))
    else:
        tables.print_spectrum(found)


@app.command()
@control_options("strength", "threads")
def evaluate(
    folders: Annotated[
        list[Path] | None,
        Argument(
            metavar="[DIR...]",
            help="Folders that each contain noisy.* and clean.*, or folders of such folders.",
            show_default=False,
        ),
    ] = None,
    *,
    dataset: Annotated[
        str | None,
        Option(
            metavar="NAME", help="Public data set, read from --from. Use `list` to see all sets and where to get them."
        ),
    ] = None,
    copy: Annotated[
        Path | None,
        Option("--from", metavar="DIR", help="Your copy of the public set, which is a clone or an unpacked archive."),
    ] = None,
    split: Annotated[
        Literal["test", "train"], Option(metavar="test|train", help="Published split of the public set.")
    ] = "test",
    noise: Annotated[
        float | None,
        Option(
            metavar="LEVEL",
            help="Instead of using noisy.*, add Gaussian noise along the normals to clean.*, with this standard "
            "deviation in mean edge lengths.",
        ),
    ] = None,
    seeds: Annotated[
        int, Option(min=1, help="Number of noisy versions of each clean mesh. The tables show the spread over them.")
    ] = 1,
    method: Annotated[
        list[str] | None,
        Option(
            metavar="NAME",
            help="Method to evaluate. Repeat the option to evaluate several. By default: auto, cascade, "
            "bilateral-normal, guided-normal and l0.",
        ),
    ] = None,
    result: Annotated[
        list[str] | None,
        Option(
            metavar="NAME=DIR",
            help="Add results of another program, which are the meshes DIR/<pair>.*. Repeat the option to add several.",
        ),
    ] = None,
    command: Annotated[
        list[str] | None,
        Option(
            metavar="'NAME=PROG {in} {out}'",
            help="Run another program on each noisy mesh. {in.obj} and {out.obj} convert to and from that format. "
            "Repeat the option to run several.",
        ),
    ] = None,
    timeout: Annotated[
        float, Option(metavar="SECONDS", help="Stop a program of --command that takes longer than this for one mesh.")
    ] = 3600.0,
    settings: Set = None,
    csv: Annotated[Path | None, Option(metavar="FILE", help="Write all results as CSV.")] = None,
    markdown: Annotated[Path | None, Option(metavar="FILE", help="Write tables as Markdown.")] = None,
    latex: Annotated[Path | None, Option(metavar="FILE", help="Write tables as LaTeX.")] = None,
    html: Annotated[
        Path | None,
        Option(
            metavar="FILE", help="Write an HTML page of tables and figures, and a page with a 3-D viewer for each pair."
        ),
    ] = None,
    keep: Annotated[
        Path | None,
        Option(
            metavar="DIR",
            help="Keep the denoised meshes in this folder, from which a later run reuses them. With --html, the "
            "default is a folder beside that file.",
        ),
    ] = None,
    workers: Annotated[int, Option(min=1, help="Number of processes.")] = 1,
    scheduler: Scheduler = None,
    force: Force = False,
    as_json: JsonOption = False,
    **controls: Any,
) -> None:
    """Denoise pairs of noisy.* and clean.* with several methods, or with other programs, and measure the results."""
    from cascadenorm.cli import progress_bars, tables
    from cascadenorm.evaluation import harness
    from cascadenorm.io.atomic import check_outputs

    if dataset == "list":
        tables.print_public_sets()
        return
    places: list[FilePair | Path] = [*_public_pairs(dataset, copy, split), *(folders or [])]
    if not places:
        raise typer.BadParameter("give folders of pairs, or --dataset NAME --from DIR")
    check_outputs(csv, markdown, latex, html, force=force)
    if html is not None:
        from cascadenorm.reports.evaluations import check_evaluation, report_evaluation

        folder = check_evaluation(html, force=force)
        keep = keep or folder
    with progress_bars.progress_tasks() as progress:
        done = harness.evaluate(
            places,
            methods=method or harness.DEFAULT_METHODS,
            results=named_values("--result", result),
            commands=named_values("--command", command),
            timeout=timeout,
            parameters=parameter_values(settings),
            noise=noise,
            seeds=seeds,
            keep=keep,
            workers=workers,
            scheduler=scheduler,
            progress=progress,
            **controls,
        )
        if html is not None:
            report_evaluation(html, done, force=force, progress=progress)
    _print_results(done, as_json=as_json)
    _write_tables(done, csv=csv, markdown=markdown, latex=latex, force=force)
    if done.failures:
        raise typer.Exit(PARTLY)


def _print_results(done: "Evaluation", *, as_json: bool) -> None:
    from cascadenorm.cli import tables

    for measured in done.results:
        if not measured.same_faces:
            notify(f"{measured.pair}, {measured.method}: faces differ from clean.*; compared with the nearest faces")
    for failure in done.failures:
        notify(f"{failure.pair}{f', {failure.method}' if failure.method else ''}: {worded(failure.error)}")
    if as_json:
        failures = [{"pair": f.pair, "method": f.method, "message": worded(f.error)} for f in done.failures]
        rows = {"results": [one.row() for one in done.results], "means": [one.row() for one in done.means]}
        tables.print_json("evaluate", {**rows, "failures": failures})
    else:
        tables.print_evaluation(done)


def _write_tables(
    done: "Evaluation", *, csv: Path | None, markdown: Path | None, latex: Path | None, force: bool
) -> None:
    from cascadenorm.evaluation import tables
    from cascadenorm.io.atomic import write_atomically

    every = tables.all_tables(done)
    texts = ((csv, tables.csv_text(done)), (markdown, tables.markdown(every)), (latex, tables.latex(every)))
    for target, text in texts:
        if target is not None:
            write_atomically(target, [text.encode(errors="replace")], force=force)  # names may be no Unicode


def _public_pairs(dataset: str | None, copy: Path | None, split: Literal["test", "train"]) -> "list[FilePair]":
    """Return the pairs of a public set, if one is requested; without a copy, report where to get one."""
    from cascadenorm.evaluation.public_sets import public_pairs, public_set

    if dataset is None:
        if copy is not None:
            raise typer.BadParameter("--from needs --dataset, the name of the public set")
        return []
    if copy is None:
        raise typer.BadParameter(
            f"--dataset {dataset} needs --from DIR, your copy of the set; to get one: {public_set(dataset).place}"
        )
    return public_pairs(dataset, copy, split=split)


@app.command()
def methods(
    name: Annotated[
        str | None, Argument(help="Method whose parameters to show. By default, all methods are listed.")
    ] = None,
    *,
    as_json: JsonOption = False,
) -> None:
    """List all methods, or the parameters of one method."""
    from cascadenorm.api import api
    from cascadenorm.cli import tables
    from cascadenorm.registry import find

    known = api.methods()
    chosen = known if name is None else {name: find(name)}
    if as_json:
        tables.print_json("methods", {"methods": [tables.method_json(one) for one in chosen.values()]})
    elif name is None:
        tables.print_methods(known)
    else:
        tables.print_method(chosen[name])
