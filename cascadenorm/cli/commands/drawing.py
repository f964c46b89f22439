"""Commands that draw meshes."""

from pathlib import Path
from typing import Annotated, cast

import typer

from cascadenorm.cli.app import app
from cascadenorm.cli.options import Force


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
