"""Pictures of mesh files."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from cascadenorm.interop import as_mesh
from cascadenorm.io import OutputError
from cascadenorm.io.atomic import check_output, write_atomically
from cascadenorm.mesh import MeshError, scaled_alike
from cascadenorm.render import Camera, png, render, side_by_side
from cascadenorm.render.pillow import require_pillow


def draw(
    meshes: Sequence[Any],
    output: str | PathLike[str],
    *,
    size: int = 600,
    direction: ArrayLike | None = None,
    force: bool = False,
) -> None:
    """Draw meshes side by side, each above its name, from where the last is seen well; what that does not show, alone.

    Parameters
    ----------
    meshes : paths, or meshes of any kind that `denoise` takes
    output : PNG file
    size : width and height of each picture in pixels
    direction : from the meshes toward the viewer, as in `Camera.looking_at`
    force : replace an existing file

    Raises
    ------
    ReadError, MeshError : a mesh that cannot be read or drawn, or none
    OutputError : the file exists and force is not given, or it cannot be written
    MissingDependencyError : Pillow is not installed
    """
    require_pillow()
    output = Path(output)
    check_output(output, force=force)
    if output.suffix.lower() not in ("", ".png"):
        raise OutputError(f"{output} would hold a PNG picture: give a name that ends in .png")
    if not meshes:
        raise MeshError("there are no meshes to draw: give at least one")
    names = [Path(mesh).name if isinstance(mesh, str | Path) else "" for mesh in meshes]
    drawn = scaled_alike(*(as_mesh(mesh) for mesh in meshes))
    last = Camera.looking_at(drawn[-1], direction=direction)
    views = [last if last.shows(mesh) else Camera.looking_at(mesh, direction=direction) for mesh in drawn]
    pictures = [render(mesh, view=view, size=(size, size)) for mesh, view in zip(drawn, views, strict=True)]
    write_atomically(output, [png(side_by_side(pictures, names))], force=force)
