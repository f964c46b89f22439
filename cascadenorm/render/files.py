"""Render mesh files to picture files."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cascadenorm.io import OutputError
from cascadenorm.io.atomic import check_output, write_atomically
from cascadenorm.io.interop import as_mesh
from cascadenorm.mesh import MeshError
from cascadenorm.render import pixels, png, webp
from cascadenorm.render.encoding import animated_webp, mp4, require_ffmpeg
from cascadenorm.render.figure import pdf, svg
from cascadenorm.render.scenes import Style, check_style, figure, one_view, scene, turntable_views
from cascadenorm.render.style import DPI

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MILLISECONDS = 60  # duration of each frame of a turntable in milliseconds


def draw(
    meshes: Sequence[Any],
    output: str | PathLike[str],
    style: Style | None = None,
    *,
    names: Sequence[str] | None = None,
    turntable: bool = False,
    force: bool = False,
) -> None:
    """Draw meshes side by side, each above its caption.

    The camera is chosen for the last mesh. Meshes that it does not show get their own camera. A UserWarning names the
    characters of captions that no installed font has.

    Parameters
    ----------
    meshes
        Paths, or meshes of any kind that `denoise` accepts.
    output
        PNG, WebP, SVG or PDF file; SVG and PDF contain text and lines as vectors.
    style
        Camera, colours and enlarged parts.
    names
        Captions. None uses the file names.
    turntable
        Write a WebP or MP4 file in which the meshes rotate about the up axis; MP4 needs the program ffmpeg.
    force
        Replace an existing file.

    Raises
    ------
    ReadError, MeshError
        A mesh cannot be read or drawn, or no mesh is given.
    ParameterError
        Values are unknown or need another mesh, or a part lies outside the picture.
    OutputError
        The file exists and `force` is False, it cannot be written, or ffmpeg is missing for an MP4 file.
    """
    output, style = Path(output), style or Style()
    encode = _encoder(output, turntable=turntable)
    if encode is mp4:
        require_ffmpeg()
        style = replace(style, transparent=False)  # MP4 has no transparency
    check_output(output, force=force)
    if not meshes:
        raise MeshError("there are no meshes to draw: give at least one")
    check_style(style, len(meshes))
    named = names or [Path(mesh).name if isinstance(mesh, str | PathLike) else "" for mesh in meshes]
    shown = scene([as_mesh(mesh) for mesh in meshes], named, style)
    if turntable:
        images = (pixels(figure(shown, views), transparent=style.transparent) for views in turntable_views(shown))
        data = encode(images, milliseconds=MILLISECONDS)
    else:
        data = encode(figure(shown, one_view(shown)), transparent=style.transparent)
    write_atomically(output, [data], force=force)


def _png(figure: "Figure", *, transparent: bool) -> bytes:
    return png(pixels(figure, transparent=transparent), dpi=DPI)


def _webp(figure: "Figure", *, transparent: bool) -> bytes:
    return webp(pixels(figure, transparent=transparent))


ENCODERS: Mapping[str, Callable[..., bytes]] = {".png": _png, ".webp": _webp, ".svg": svg, ".pdf": pdf, "": _png}
"""Encoders of a figure by file extension."""
TURNTABLES: Mapping[str, Callable[..., bytes]] = {".webp": animated_webp, ".mp4": mp4}
"""Encoders of a turntable by file extension."""


def _encoder(output: Path, *, turntable: bool) -> Callable[..., bytes]:
    known, content = (TURNTABLES, "a turntable") if turntable else (ENCODERS, "a picture")
    suffix = output.suffix.lower()
    if suffix not in known:
        names = ", ".join(filter(None, known))
        raise OutputError(f"{output} cannot hold {content}: give a name that ends in {names}")
    return known[suffix]
