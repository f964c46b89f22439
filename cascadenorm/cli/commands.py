"""The command line: a command parses, calls one public function, prints.

Results go to stdout, messages and progress to stderr. What a command uses is imported in it, so that the command line
starts at once.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import typer

from cascadenorm.cli.errors import PARTLY, complain, worded
from cascadenorm.cli.options import Force, Json, Method, ReportFile, Set, takes_controls
from cascadenorm.messages import counted

app = typer.Typer(
    name="cascadenorm",
    help="Denoise triangle meshes by cascaded normal regression, or by one of the classical methods.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.callback(invoke_without_command=True)
def options(version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False) -> None:
    """Denoise triangle meshes by cascaded normal regression, or by one of the classical methods."""
    if version:
        from cascadenorm import __version__

        print(f"cascadenorm {__version__}")
        raise typer.Exit


@app.command()
@takes_controls()
def denoise(
    source: Annotated[str, typer.Argument(metavar="IN", help="Mesh file, or - for stdin.")],
    *,
    output: Annotated[
        str | None, typer.Option("-o", "--output", help="File, whose extension selects the format, or - for stdout.")
    ] = None,
    method: Method = "auto",
    model: Annotated[Path | None, typer.Option(help="Weights of your own, for auto or cascade.")] = None,
    settings: Set = None,
    format: Annotated[
        str | None, typer.Option("--format", metavar="EXT", help="Format of stdout, such as stl; else that of IN.")
    ] = None,
    report: ReportFile = None,
    truth: Annotated[Path | None, typer.Option(metavar="FILE", help="The true mesh, for the report.")] = None,
    force: Force = False,
    as_json: Json = False,
    **controls: Any,
) -> None:
    """Denoise a mesh file; by default into <stem>_denoised<suffix> beside it."""
    from cascadenorm import api
    from cascadenorm.cli import json_output, progress_bars, tables

    target: Any = output if output is not None else ("-" if source == "-" else None)
    parameters = _parameters(settings)
    if model is not None:
        parameters["model"] = model
    if format is not None and target != "-":
        raise typer.BadParameter("--format is for stdout: the extension of the output selects the format of a file")
    if truth is not None and report is None:
        raise typer.BadParameter("--truth is for a report: give --report as well")
    if report is not None:
        from cascadenorm import reports

        reports.check_report(report, force=force)
    with progress_bars.progress_bar("denoising") as progress:
        denoised = api.denoised_file(
            sys.stdin.buffer if source == "-" else source,
            sys.stdout.buffer if target == "-" else target,
            method=method,
            format=format,
            parameters=parameters,
            force=force,
            progress=progress,
            **controls,
        )
    if report is not None:
        reports.report_denoised(report, denoised, truth=truth, force=force)
    done = denoised.report
    out = sys.stderr if target == "-" else sys.stdout
    if as_json:
        json_output.print_json("denoise", json_output.denoised(done), file=out)
    else:
        tables.print_denoised(done, file=out)


@app.command("denoise-regions")
@takes_controls()
def denoise_regions(
    sources: Annotated[list[str], typer.Argument(metavar="IN...", help="Mesh files.")],
    *,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder, where files keep their names.")
    ] = None,
    method: Method = "auto",
    model: Annotated[Path | None, typer.Option(help="Weights of your own, for auto or cascade.")] = None,
    settings: Set = None,
    force: Force = False,
    as_json: Json = False,
    **controls: Any,
) -> None:
    """Denoise mesh files whose walls coincide, as those of a segmentation do: shared walls stay shared."""
    from cascadenorm import regions
    from cascadenorm.cli import json_output, progress_bars, tables

    parameters = _parameters(settings)
    if model is not None:
        parameters["model"] = model
    with progress_bars.progress_bar("denoising") as progress:
        done = regions.denoise_region_files(
            sources, output, method=method, parameters=parameters, force=force, progress=progress, **controls
        )
    if as_json:
        json_output.print_json("denoise-regions", {"files": [json_output.denoised(one) for one in done]})
    else:
        for one in done:
            tables.print_denoised(one, file=sys.stdout)


@app.command()
def inspect(
    source: Annotated[str, typer.Argument(metavar="IN", help="Mesh file, or - for stdin.")],
    *,
    self_intersections: Annotated[
        bool | None,
        typer.Option(help="Look for self-intersections, or do not; by default only in meshes of moderate size."),
    ] = None,
    report: ReportFile = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Report what a mesh is, its defects and where they are, and how noisy it is."""
    from cascadenorm import inspection
    from cascadenorm.cli import json_output, tables

    mesh = sys.stdin.buffer if source == "-" else source
    if report is None:
        found = inspection.inspect(mesh, self_intersections=self_intersections)
    else:
        from cascadenorm import reports

        found = reports.report(report, mesh, self_intersections=self_intersections, force=force).inspections["mesh"]
    if as_json:
        json_output.print_json("inspect", json_output.inspected(found))
    else:
        tables.print_inspection(found)


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
    folders: Annotated[list[Path], typer.Argument(metavar="DIR...", help="Pairs, or folders of pairs.")],
    *,
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

    for path in filter(None, (csv, markdown, latex)):
        check_output(path, force=force)
    if html is not None:
        from cascadenorm.reports.evaluations import check_evaluation, report_evaluation

        keep = keep or check_evaluation(html, force=force)
    with progress_bars.progress_tasks() as progress:
        done = harness.evaluate(
            folders,
            methods=method or harness.DEFAULT_METHODS,
            results=_named("--result", result),
            commands=_named("--command", command),
            parameters=_parameters(settings),
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


@app.command()
def generate(
    folder: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for the data set; it is made.")],
    *,
    count: Annotated[int, typer.Option(min=1, help="Pairs to make.")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="The same seed makes the same files.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes; the files are the same.")] = 1,
    force: Annotated[bool, typer.Option("--force", help="Write into a folder that is not empty.")] = False,
) -> None:
    """Make pairs of noisy and clean meshes: generated shapes, many kinds of noise."""
    from cascadenorm.cli import progress_bars
    from cascadenorm.evaluation import pairs

    with progress_bars.progress_tasks() as progress:
        pairs.write_pairs(folder, count=count, seed=seed, workers=workers, force=force, progress=progress)
    print(f"{counted(count, 'pair')} in {folder}")


@app.command()
@takes_controls("threads")
def train(
    *,
    output: Annotated[Path, typer.Option("-o", "--output", help="The weights file to write.")] = Path(
        "cascade.safetensors"
    ),
    config: Annotated[Path | None, typer.Option(help="Settings as TOML; what it leaves out keeps its default.")] = None,
    shapes: Annotated[
        list[Path] | None, typer.Option(help="Clean meshes of your own, a file or folder; may be given several times.")
    ] = None,
    noisy: Annotated[
        list[Path] | None, typer.Option(help="Pairs of your own, noisy.* and clean.*; may be given several times.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="A minute's training, to see that it works.")] = False,
    seed: Annotated[int | None, typer.Option(min=0, help="The same seed makes the same file.")] = None,
    force: Force = False,
    **controls: Any,
) -> None:
    """Train a cascade on generated shapes; interrupted and started again, it goes on where it was."""
    from dataclasses import replace

    from cascadenorm import models
    from cascadenorm.cli import progress_bars
    from cascadenorm.learned.config import QUICK, TrainConfig, read_config
    from cascadenorm.learned.launch import is_main

    if config is not None and quick:
        raise typer.BadParameter("--quick has settings of its own: give it or --config, not both")
    settings = QUICK if quick else TrainConfig() if config is None else read_config(config)
    if seed is not None:
        settings = replace(settings, seed=seed, data=replace(settings.data, seed=seed))
    with progress_bars.progress_tasks(log=True) as progress:
        models.train(
            settings,
            output,
            shapes=shapes or (),
            noisy=noisy or (),
            force=force,
            progress=progress,
            **controls,
        )
    if is_main():
        print(f"the model is in {output}; use it with: cascadenorm denoise scan.ply --model {output}")


@app.command("models")
def show_model(
    model: Annotated[str, typer.Argument(help="auto or cascade, which come with the package, or a file.")] = "auto",
) -> None:
    """Print the card of a model: what it was made of, how, and how well it fits, as JSON."""
    from cascadenorm import models
    from cascadenorm.cli import json_output

    json_output.print_json("models", {"model": model, "card": models.named(model).card})


@app.command("export-onnx")
def export_onnx(
    folder: Annotated[Path, typer.Argument(metavar="OUT", help="Folder for stage1.onnx and so on; it is made.")],
    *,
    model: Annotated[str, typer.Option(help="auto or cascade, which come with the package, or a file.")] = "auto",
    force: Force = False,
) -> None:
    """Write the networks of a model as ONNX files, one a stage; docs/models.md has their inputs and outputs."""
    from cascadenorm import models

    for path in models.export_onnx(models.named(model), folder, force=force):
        print(path)


@app.command()
def demo(
    folder: Annotated[Path, typer.Argument(help="Where to leave meshes and pictures; it is made.")] = Path(
        "cascadenorm-demo"
    ),
) -> None:
    """Denoise three meshes that come with the package; leave meshes and pictures in a folder."""
    from cascadenorm.cli import demo as demonstration
    from cascadenorm.cli import progress_bars, tables
    from cascadenorm.errors import MissingDependencyError

    with progress_bars.progress_tasks() as progress:
        examples = demonstration.demo(folder, progress=progress)
    tables.print_table(demonstration.table(examples))
    try:
        demonstration.draw(examples, folder)
    except MissingDependencyError as error:
        print(f"meshes are in {folder}; for pictures beside them: {error.command}")
    else:
        print(f"meshes and pictures are in {folder}; look at {folder / demonstration.BEFORE_AFTER} first")


@app.command("fill-holes")
def fill_holes(
    source: Annotated[Path, typer.Argument(metavar="IN", help="Mesh file.")],
    *,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="File; by default <stem>_filled<suffix> beside the source.")
    ] = None,
    order: Annotated[int, typer.Option(min=1, max=3, help="1 membrane, 2 goes on smoothly, 3 in curvature too.")] = 2,
    max_edges: Annotated[
        int | None, typer.Option(min=3, help="Leave longer holes open, such as the outer boundary.")
    ] = None,
    force: Force = False,
) -> None:
    """Close the holes of a mesh by patches as dense as what is around them; what is there stays as it is."""
    from cascadenorm.cli import tables
    from cascadenorm.filled_files import fill_holes_file
    from cascadenorm.io.files import beside

    target = beside(source, "filled") if output is None else output
    kind = cast(Literal[1, 2, 3], order)  # typer holds the range
    done = fill_holes_file(source, target, order=kind, max_edges=max_edges, force=force)
    print(f"{target}: {counted(done.added, 'face')} added to {done.faces}")
    tables.print_left_out(done.left_out)


@app.command()
def render(
    meshes: Annotated[
        list[str], typer.Argument(metavar="MESH...", help="Side by side, from one place if they lie alike.")
    ],
    *,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="PNG, WebP, SVG or PDF file.", show_default=False)
    ] = None,
    turntable: Annotated[
        Path | None, typer.Option(metavar="FILE", help="WebP file in which the meshes turn once around.")
    ] = None,
    size: Annotated[int, typer.Option(min=16, help="Width and height of each picture in pixels.")] = 600,
    view: Annotated[
        str | None,
        typer.Option(
            metavar="WHERE",
            help="The viewer is at: front, back, left, right, top, bottom or three-quarter; or AZIMUTH,ELEVATION in "
            "degrees; or in the direction X,Y,Z.",
        ),
    ] = None,
    up: Annotated[str, typer.Option(metavar="x|y|z", help="Axis of the meshes that is upward.")] = "y",
    target: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Point in the middle of the picture, else that of the mesh.")
    ] = None,
    distance: Annotated[
        float | None, typer.Option(help="Of the viewer from there, in the unit of the meshes; else all is seen.")
    ] = None,
    values: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Heat map: normal-error, distance, angle, displacement, normal-displacement, curvature or noise.",
        ),
    ] = None,
    reference: Annotated[
        Path | None, typer.Option(metavar="FILE", help="What they are measured against; else the first mesh.")
    ] = None,
    limits: Annotated[str | None, typer.Option(metavar="LOW,HIGH", help="Values at the ends of the colours.")] = None,
    crop: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y,WIDTH",
            help="Enlarge a square below each picture: its middle and width as shares of the picture from the upper "
            "left. May be given several times.",
        ),
    ] = None,
    smooth: Annotated[bool, typer.Option("--smooth", help="Smooth shading.")] = False,
    wireframe: Annotated[bool, typer.Option("--wireframe", help="Draw the edges.")] = False,
    transparent: Annotated[bool, typer.Option("--transparent", help="No white background.")] = False,
    force: Force = False,
) -> None:
    """Draw meshes into a picture, without a GPU or a window."""
    from cascadenorm.cli import pictures
    from cascadenorm.render.files import draw
    from cascadenorm.render.scenes import Style

    if output is None and turntable is None:
        raise typer.BadParameter("there is nothing to write: give --output or --turntable")
    axis = pictures.upward(up)
    style = Style(
        size=size,
        direction=pictures.direction(view, up=axis),
        up=axis,
        target=pictures.numbers("--target", target, 3),
        distance=distance,
        values=values,
        reference=reference,
        limits=cast(tuple[float, float] | None, pictures.numbers("--limits", limits, 2)),
        crops=pictures.crops(crop),
        smooth=smooth,
        wireframe=wireframe,
        transparent=transparent,
    )
    for path, turning in ((output, False), (turntable, True)):
        if path is not None:
            draw(meshes, path, style, turntable=turning, force=force)
            print(path)


def _parameters(settings: Sequence[str] | None) -> dict[str, Any]:
    """Read NAME=VALUE pairs; the method checks names and values."""
    return {name.replace("-", "_"): value for name, value in _named("--set", settings).items()}


VALUES = {"--result": "DIR", "--command": "'PROG {in} {out}'"}
"""What follows the name in options of two parts."""


def _named(option: str, given: Sequence[str] | None) -> dict[str, str]:
    """Read the NAME=VALUE pairs of an option."""
    pairs = [text.partition("=") for text in given or ()]
    for name, equals, _ in pairs:
        if not (name and equals):
            raise typer.BadParameter(f"{option} {name or equals}: write it as NAME={VALUES.get(option, 'VALUE')}")
    return {name.strip(): value.strip() for name, _, value in pairs}
