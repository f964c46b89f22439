"""Commands that show meshes: studio, demo and render."""

import sys
import warnings
from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Annotated, Literal, cast

import typer
from typer import Argument, Option

from cascadenorm.cli.options import Force, app


@app.command()
def studio(
    file: Annotated[
        Path | None, Argument(metavar="[FILE]", help="Mesh file. You can also drop one onto the page.")
    ] = None,
    *,
    port: Annotated[int, Option(min=0, max=65535, help="Port of the local server; 0 selects a free port.")] = 0,
    browser: Annotated[bool, Option("--browser/--no-browser", help="Whether to open the page in the browser.")] = True,
    max_size: Annotated[
        float, Option(min=0, metavar="MB", help="Largest file size that is accepted, in megabytes.")
    ] = 1000,
) -> None:
    """Denoise in the browser: preview the result as you change settings, paint masks, and save."""
    from cascadenorm.studio import studio

    studio(file, port=port, browser=browser, max_size=max_size)


@app.command()
def demo(
    folder: Annotated[Path, Argument(help="Folder to create for meshes and pictures.")] = Path("cascadenorm-demo"),
    *,
    force: Force = False,
) -> None:
    """Denoise three meshes that ship with the package, and write meshes and pictures to a folder."""
    from cascadenorm.cli import demo as demonstration
    from cascadenorm.cli import progress_bars, tables
    from cascadenorm.geometry.metrics import SYMBOLS

    with progress_bars.progress_tasks() as progress:
        done = demonstration.demo(folder, force=force, progress=progress)
    tables.print_evaluation(done)
    print(SYMBOLS)
    demonstration.draw_demo(done, folder)
    print(f"the meshes and pictures are in {folder}; start with {folder / demonstration.BEFORE_AFTER}")


@app.command()
def render(
    meshes: Annotated[
        list[str],
        Argument(metavar="MESH...", help="Mesh files, drawn side by side. Overlapping meshes share one camera."),
    ],
    *,
    output: Annotated[
        Path | None, Option("-o", "--output", help="Output file in PNG, WebP, SVG or PDF format.", show_default=False)
    ] = None,
    turntable: Annotated[
        Path | None,
        Option(
            metavar="FILE", help="Animation of one full turn of the meshes: a WebP file, or MP4 if ffmpeg is installed."
        ),
    ] = None,
    size: Annotated[int, Option(min=16, help="Width and height of each picture in pixels.")] = 600,
    view: Annotated[
        str | None,
        Option(
            metavar="WHERE",
            help="Position of the camera: front, back, left, right, top, bottom or three-quarter; an azimuth and an "
            "elevation in degrees, such as 30,20; or a direction X,Y,Z. The default is the front of an open "
            "surface and a three-quarter view of others.",
        ),
    ] = None,
    up: Annotated[Literal["x", "y", "z"], Option(metavar="x|y|z", help="Up axis of the meshes.")] = "y",
    target: Annotated[
        str | None,
        Option(metavar="X,Y,Z", help="Point in the centre of the picture. By default, the centre of the mesh."),
    ] = None,
    distance: Annotated[
        float | None,
        Option(help="Distance from the camera to the target, in mesh units. By default, the whole mesh is visible."),
    ] = None,
    values: Annotated[
        str | None,
        Option(
            metavar="NAME",
            help="Quantity to show as a heat map: normal-error, distance, angle, displacement, normal-displacement, "
            "curvature or noise.",
        ),
    ] = None,
    reference: Annotated[
        Path | None, Option(metavar="FILE", help="Mesh to compare with. By default, the first mesh.")
    ] = None,
    limits: Annotated[
        str | None,
        Option(
            metavar="LOW,HIGH",
            help="Values at the two ends of the colour scale. By default, they follow from the meshes.",
        ),
    ] = None,
    crop: Annotated[
        list[str] | None,
        Option(
            metavar="X,Y,WIDTH",
            help="Show an enlarged square below each picture, given by its centre and width as fractions of the "
            "picture, measured from the upper left corner. Repeat the option to show several.",
        ),
    ] = None,
    smooth: Annotated[bool, Option("--smooth", help="Use smooth shading.")] = False,
    wireframe: Annotated[bool, Option("--wireframe", help="Draw the edges.")] = False,
    transparent: Annotated[bool, Option("--transparent", help="Make the background transparent.")] = False,
    force: Force = False,
) -> None:
    """Render meshes to a picture, without a GPU or a window."""
    from cascadenorm.io.atomic import check_outputs
    from cascadenorm.render.files import draw
    from cascadenorm.render.scenes import Style

    if output is None and turntable is None:
        raise typer.BadParameter("there is nothing to write: give --output or --turntable")
    style = Style(
        size=size,
        direction=_view_direction(view, up=up),
        up=up,
        target=_numbers("--target", target, 3),
        distance=distance,
        values=values,
        reference=reference,
        limits=cast(tuple[float, float] | None, _numbers("--limits", limits, 2)),
        crops=_crops(crop),
        smooth=smooth,
        wireframe=wireframe,
        transparent=transparent,
    )
    check_outputs(output, turntable, force=force)
    for path, turning in ((output, False), (turntable, True)):
        if path is not None:
            with warnings.catch_warnings(record=True) as said:
                warnings.filterwarnings("always", "no font on this machine", UserWarning)
                draw(meshes, path, style, turntable=turning, force=force)
            for line in dict.fromkeys(str(one.message) for one in said):
                print(f"warning: {line}", file=sys.stderr)
            print(path)


def _view_direction(view: str | None, *, up: Literal["x", "y", "z"]) -> tuple[float, ...] | None:
    """Parse the direction to the viewer: a name, two angles in degrees, or a vector."""
    from cascadenorm.render.camera import AROUND, direction_of_angles, named_direction

    if view is None:
        return None
    if view in AROUND:
        return named_direction(view, up=up)
    found = _parsed(view)
    if len(found) == 2:
        return direction_of_angles(*found, up=up)
    if len(found) != 3 or not any(found):
        raise typer.BadParameter(
            f"--view {view}: write a direction such as 0.5,0.4,0.8, two angles such as 30,20, or one of "
            f"{', '.join(AROUND)}"
        )
    return found


def _numbers(option: str, text: str | None, count: int) -> tuple[float, ...] | None:
    """Parse finite numbers separated by commas."""
    if text is None:
        return None
    found = _parsed(text)
    if len(found) != count:
        raise typer.BadParameter(f"{option} {text}: write {count} numbers, such as {','.join(map(str, range(count)))}")
    return found


def _crops(texts: Sequence[str] | None) -> list[tuple[float, float, float]]:
    """Parse the parts of the picture to enlarge."""
    return [cast(tuple[float, float, float], _numbers("--crop", text, 3)) for text in texts or ()]


def _parsed(text: str) -> tuple[float, ...]:
    """Parse numbers separated by commas; return an empty tuple if one of them is invalid."""
    try:
        found = tuple(map(float, text.split(",")))
    except ValueError:
        return ()
    return found if all(map(isfinite, found)) else ()
