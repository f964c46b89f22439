"""Commands that denoise, repair and inspect meshes."""

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal, cast

import typer
from typer import Argument, Option

from cascadenorm.cli.errors import PARTLY, located, notify, warn_of_strength, worded
from cascadenorm.cli.options import (
    Force,
    JsonOption,
    MethodOption,
    ModelOption,
    ReportFile,
    Scheduler,
    Set,
    app,
    control_options,
    parameter_values,
)
from cascadenorm.compute.compile_time import tell_of_compiling


@app.command()
@control_options()
def denoise(
    source: Annotated[str, Argument(metavar="IN", help="Mesh file, or - for standard input.")],
    *,
    output: Annotated[
        str | None,
        Option(
            "-o",
            "--output",
            metavar="FILE",
            help="Output file, or - for standard output. The extension selects the format.",
        ),
    ] = None,
    method: MethodOption = "auto",
    model: ModelOption = None,
    settings: Set = None,
    format: Annotated[
        str | None,
        Option("--format", metavar="EXT", help="Format of standard output, such as stl. By default, that of IN."),
    ] = None,
    report: ReportFile = None,
    truth: Annotated[Path | None, Option(metavar="FILE", help="Ground truth mesh for the report.")] = None,
    memory: Annotated[
        str | None,
        Option(
            metavar="SIZE", help="Memory to use, such as 4GB. Larger meshes are denoised in patches (docs/patches.md)."
        ),
    ] = None,
    scheduler: Scheduler = None,
    weld: Annotated[
        str | None,
        Option(
            metavar="LENGTH",
            help="Weld boundary vertices at most this far apart, in mesh units or in mean edge lengths, as in "
            '"0.001 edges".',
        ),
    ] = None,
    drop_components: Annotated[
        str | None,
        Option(
            metavar="SIZE",
            help="Drop connected components with fewer faces than this number, or than this percentage of the largest "
            "component, such as 1%.",
        ),
    ] = None,
    force: Force = False,
    as_json: JsonOption = False,
    **controls: Any,
) -> None:
    """Denoise a mesh file. By default, the result is written to <stem>_denoised<suffix> beside the input."""
    from cascadenorm.api import api
    from cascadenorm.api.inspection.inspection import new_faults
    from cascadenorm.cli import progress_bars, tables

    target: Any = "-" if output == "/dev/stdout" or (output is None and source == "-") else output
    if as_json and target == "-":
        tell_of_compiling(None)  # stderr is reserved for the JSON object
    parameters = parameter_values(settings, model)
    warn_of_strength(controls["strength"])
    if format is not None and target != "-":
        raise typer.BadParameter("--format applies to stdout only: the extension of --output selects that of a file")
    if truth is not None and report is None:
        raise typer.BadParameter("--truth needs --report: the true mesh is used in the report only")
    if report is not None:
        from cascadenorm import reports

        reports.check_report(report, force=force)
        true_mesh = None if truth is None else reports.checked_truth(truth)
    with progress_bars.progress_bar("denoising") as progress:
        denoised = api.denoise_file_with_meshes(
            sys.stdin.buffer if source == "-" else source,
            sys.stdout.buffer if target == "-" else target,
            method=method,
            format=format,
            parameters=parameters,
            weld=weld,
            force=force,
            drop_components=drop_components,
            memory=memory,
            scheduler=scheduler,
            on_short=lambda why: notify(f"{source}: {why}: it is denoised in patches (docs/patches.md)"),
            progress=progress,
            **controls,
        )
    if report is not None:
        reports.report_denoised(report, denoised, truth=true_mesh, force=force)
    done = denoised.summary
    out = sys.stderr if target == "-" else sys.stdout
    if as_json:
        faults = tables.faults_json(*denoised.seen)
        tables.print_json("denoise", {**asdict(done), **faults}, file=out)
    else:
        tables.print_denoised(done, file=out)
        tables.print_new_faults(new_faults(*denoised.seen))
        if report is not None:
            print(f"report: {report}", file=out)


@app.command()
@control_options()
def batch(
    sources: Annotated[
        list[str], Argument(metavar="IN...", help="Files, folders, URLs, or quoted patterns such as 'scans/**/*.ply'.")
    ],
    *,
    output: Annotated[
        str, Option("-o", "--output", metavar="DIR", help="Folder for the results, or a URL in an object store.")
    ],
    method: MethodOption = "auto",
    model: ModelOption = None,
    settings: Set = None,
    format: Annotated[
        str | None,
        Option("--format", metavar="EXT", help="Format of the results, such as stl. By default, that of each input."),
    ] = None,
    workers: Annotated[int | None, Option(min=1, help="Maximum number of processes. By default, one per core.")] = None,
    memory: Annotated[
        str | None,
        Option(
            metavar="SIZE", help="Memory for all processes together, such as 4GB. By default, 80 % of the free memory."
        ),
    ] = None,
    retries: Annotated[
        int, Option(min=0, help="Further attempts for a file that ran out of memory or whose process ended.")
    ] = 1,
    timeout: Annotated[
        float | None,
        Option(
            metavar="SECONDS", help="Stop working on a file after this many seconds. By default, there is no limit."
        ),
    ] = None,
    watch: Annotated[
        float | None,
        Option(
            min=0,
            metavar="SECONDS",
            help="Keep watching for new files, and denoise each once it has not changed for this many seconds.",
        ),
    ] = None,
    scheduler: Scheduler = None,
    manifest: Annotated[
        Path | None,
        Option(metavar="FILE", help="File that records which inputs are done. By default, manifest.jsonl in DIR."),
    ] = None,
    force: Force = False,
    as_json: JsonOption = False,
    **controls: Any,
) -> None:
    """Denoise many files into a folder. Files already done are skipped, and failures do not stop the others."""
    from cascadenorm.batch.batch import denoise_files
    from cascadenorm.cli import progress_bars, tables

    warn_of_strength(controls["strength"])
    with progress_bars.progress_bar("denoising", time_left=True) as progress:
        done = denoise_files(
            sources,
            output,
            method=method,
            format=format,
            force=force,
            parameters=parameter_values(settings, model),
            workers=workers,
            memory=memory,
            retries=retries,
            timeout=timeout,
            watch=watch,
            scheduler=scheduler,
            manifest=manifest,
            on_failure=lambda failure: notify(located(failure.source, failure.error)),
            progress=progress,
            **controls,
        )
    if as_json:
        failures = [{"input": failure.source, "message": worded(failure.error)} for failure in done.failures]
        about = {"files": done.lines, "kept": done.kept, "skipped": done.skipped, "failures": failures}
        tables.print_json("batch", about)
    else:
        tables.print_batch(done, output)
    if done.failures:
        raise typer.Exit(PARTLY)


@app.command("denoise-regions")
@control_options()
def denoise_regions(
    sources: Annotated[list[str], Argument(metavar="IN...", help="Mesh files.")],
    *,
    output: Annotated[
        Path | None,
        Option(
            "-o", "--output", metavar="DIR", help="Folder for the results, which keep the file names of the inputs."
        ),
    ] = None,
    method: MethodOption = "auto",
    model: ModelOption = None,
    settings: Set = None,
    force: Force = False,
    as_json: JsonOption = False,
    **controls: Any,
) -> None:
    """Denoise mesh files with coincident walls, such as segmented regions. Shared walls remain identical."""
    from cascadenorm.api.regions import regions
    from cascadenorm.cli import progress_bars, tables

    parameters = parameter_values(settings, model)
    warn_of_strength(controls["strength"])
    with progress_bars.progress_bar("denoising") as progress:
        done = regions.denoise_region_files(
            sources, output, method=method, parameters=parameters, force=force, progress=progress, **controls
        )
    if as_json:
        tables.print_json("denoise-regions", {"files": [asdict(one) for one in done]})
    else:
        for one in done:
            tables.print_denoised(one, file=sys.stdout, can_weld=False)


@app.command()
def inspect(
    source: Annotated[str, Argument(metavar="IN", help="Mesh file, or - for standard input.")],
    *,
    self_intersections: Annotated[
        bool | None,
        Option(help="Whether to check for self-intersections. By default, only meshes of moderate size are checked."),
    ] = None,
    report: ReportFile = None,
    force: Force = False,
    as_json: JsonOption = False,
) -> None:
    """Report the size and topology of a mesh, its defects and their locations, and its noise level."""
    from cascadenorm.api import inspection
    from cascadenorm.cli import tables

    mesh = sys.stdin.buffer if source == "-" else source
    if report is None:
        found = inspection.inspect(mesh, self_intersections=self_intersections)
    else:
        from cascadenorm import reports

        found = reports.report(report, mesh, self_intersections=self_intersections, force=force).inspections["mesh"]
    if as_json:
        tables.print_json("inspect", asdict(found))
    else:
        tables.print_inspection(found)
        if report is not None:
            print(f"report: {report}")


@app.command("fill-holes")
def fill_holes(
    source: Annotated[Path, Argument(metavar="IN", help="Mesh file.")],
    *,
    output: Annotated[
        Path | None, Option("-o", "--output", help="Output file. By default, <stem>_filled<suffix> beside the input.")
    ] = None,
    order: Annotated[
        int,
        Option(
            min=1, max=3, help="Continuity across the boundary of a hole: 1 position, 2 tangent plane, 3 curvature."
        ),
    ] = 2,
    max_edges: Annotated[
        int | None,
        Option(min=3, help="Leave holes with more boundary edges than this open. By default, all holes are filled."),
    ] = None,
    outer: Annotated[
        Literal["keep", "fill"],
        Option(
            metavar="keep|fill",
            help="Whether to keep or fill the outer boundary of an open surface, such as a scan from one side.",
        ),
    ] = "keep",
    force: Force = False,
) -> None:
    """Fill the holes of a mesh with patches of matching density. Existing vertices and faces stay unchanged.

    PLY, OBJ and glTF files keep all their other content. In glTF, a patch continues the surrounding material, texture
    coordinates and colours; a patch across a seam of the texture coordinates gets the material without its textures.
    """
    from cascadenorm.api.filled_files import fill_holes_file
    from cascadenorm.cli import tables
    from cascadenorm.io.files import beside

    target = beside(source, "filled") if output is None else output
    kind = cast(Literal[1, 2, 3], order)  # typer enforces the range
    done = fill_holes_file(source, target, order=kind, max_edges=max_edges, outer=outer, force=force)
    tables.print_filling(target, done, max_edges)
    tables.print_left_out(done.left_out)
