"""Commands that draw meshes."""

import sys
import warnings
from pathlib import Path
from typing import Annotated, cast

import typer

from cascadenorm.cli.app import app
from cascadenorm.cli.options import Force


@app.command()
def demo(
    folder: Annotated[Path, typer.Argument(help="Folder to create for meshes and pictures.")] = Path(
        "cascadenorm-demo"
    ),
    *,
    force: Force = False,
) -> None:
    """Denoise three meshes that ship with the package, and write meshes and pictures to a folder."""
    from cascadenorm.cli import demo as demonstration
    from cascadenorm.cli import progress_bars, tables

    with progress_bars.progress_tasks() as progress:
        examples = demonstration.demo(folder, force=force, progress=progress)
    tables.print_table(demonstration.table(examples))
    demonstration.draw(examples, folder)
    print(f"the meshes and pictures are in {folder}; start with {folder / demonstration.BEFORE_AFTER}")


Meshes = Annotated[
    list[str],
    typer.Argument(metavar="MESH...", help="Mesh files, drawn side by side. Overlapping meshes share one camera."),
]
Output = Annotated[
    Path | None, typer.Option("-o", "--output", help="Output file in PNG, WebP, SVG or PDF format.", show_default=False)
]
Turntable = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Animation of one full turn of the meshes: a WebP file, or MP4 if ffmpeg is installed."
    ),
]
Size = Annotated[int, typer.Option(min=16, help="Width and height of each picture in pixels.")]
View = Annotated[
    str | None,
    typer.Option(
        metavar="WHERE",
        help="Position of the camera: front, back, left, right, top, bottom or three-quarter; an azimuth and an "
        "elevation in degrees, such as 30,20; or a direction X,Y,Z. The default is the front of an open "
        "surface and a three-quarter view of others.",
    ),
]
Upward = Annotated[str, typer.Option(metavar="x|y|z", help="Up axis of the meshes.")]
Target = Annotated[
    str | None,
    typer.Option(metavar="X,Y,Z", help="Point in the centre of the picture. By default, the centre of the mesh."),
]
Distance = Annotated[
    float | None,
    typer.Option(help="Distance from the camera to the target, in mesh units. By default, the whole mesh is visible."),
]
ValuesOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Quantity to show as a heat map: normal-error, distance, angle, displacement, normal-displacement, "
        "curvature or noise.",
    ),
]
Reference = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Mesh to compare with. By default, the first mesh.")
]
Limits = Annotated[
    str | None,
    typer.Option(
        metavar="LOW,HIGH", help="Values at the two ends of the colour scale. By default, they follow from the meshes."
    ),
]
Crops = Annotated[
    list[str] | None,
    typer.Option(
        metavar="X,Y,WIDTH",
        help="Show an enlarged square below each picture, given by its centre and width as fractions of the picture, "
        "measured from the upper left corner. Repeat the option to show several.",
    ),
]
Smooth = Annotated[bool, typer.Option("--smooth", help="Use smooth shading.")]
Wireframe = Annotated[bool, typer.Option("--wireframe", help="Draw the edges.")]
Transparent = Annotated[bool, typer.Option("--transparent", help="Make the background transparent.")]


@app.command()
def render(
    meshes: Meshes,
    *,
    output: Output = None,
    turntable: Turntable = None,
    size: Size = 600,
    view: View = None,
    up: Upward = "y",
    target: Target = None,
    distance: Distance = None,
    values: ValuesOption = None,
    reference: Reference = None,
    limits: Limits = None,
    crop: Crops = None,
    smooth: Smooth = False,
    wireframe: Wireframe = False,
    transparent: Transparent = False,
    force: Force = False,
) -> None:
    """Render meshes to a picture, without a GPU or a window."""
    from cascadenorm.cli import pictures
    from cascadenorm.io.atomic import check_output
    from cascadenorm.render.files import draw
    from cascadenorm.render.scenes import Style

    if output is None and turntable is None:
        raise typer.BadParameter("there is nothing to write: give --output or --turntable")
    axis = pictures.upward(up)
    style = Style(
        size=size,
        direction=pictures.view_direction(view, up=axis),
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
    for target_file in filter(None, (output, turntable)):
        check_output(target_file, force=force)
    for path, turning in ((output, False), (turntable, True)):
        if path is not None:
            with warnings.catch_warnings(record=True) as said:
                warnings.filterwarnings("always", "no font on this machine", UserWarning)
                draw(meshes, path, style, turntable=turning, force=force)
            for line in dict.fromkeys(str(one.message) for one in said):
                print(f"warning: {line}", file=sys.stderr)
            print(path)
