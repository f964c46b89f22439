"""Denoise, measure and draw the three noisy meshes that ship with the package."""

import time
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rich.table import Table

from cascadenorm.api.api import denoise
from cascadenorm.execution.progress import Progress, no_progress
from cascadenorm.io import OutputError
from cascadenorm.io.atomic import check_output, make_folder, write_atomically
from cascadenorm.io.interop import as_mesh, save_mesh
from cascadenorm.mesh import Mesh, angles_between
from cascadenorm.render import Bar, Camera, HeatMap, Panel, montage, pixels, png, render

EXAMPLES: dict[str, ArrayLike | None] = {"part": (0.45, 0.4, 0.8), "head": (0.15, 0.15, 1), "scan": None}
"""Name of each example, and the direction from the mesh to the viewer."""

METHODS = ("bilateral-normal", "cascade", "auto")
FOLDER = Path("cascadenorm-demo")
BEFORE_AFTER, ERRORS = "before-after.png", "errors.png"

_DATA = Path(__file__).parent.parent / "demo_data"
_PANEL = (400, 400)
_LIMITS = (0.0, 20.0)  # degrees; range of the error colours


class Outcome(NamedTuple):
    """Result of a method on an example: mesh, angle error of each face in degrees, and run time in seconds."""

    method: str
    mesh: Mesh
    angles: NDArray[np.float64]
    seconds: float


class Example(NamedTuple):
    """An example mesh with its noisy version and the results of all methods."""

    name: str
    clean: Mesh
    noisy: Outcome
    denoised: tuple[Outcome, ...]


def demo(
    folder: str | PathLike[str] = FOLDER,
    *,
    methods: Sequence[str] = METHODS,
    force: bool = False,
    progress: Progress = no_progress,
) -> list[Example]:
    """Denoise the examples by methods with their default parameters, write the meshes to a folder, and return them.

    Each example is measured against its clean mesh. `force` replaces files of an earlier demonstration; other files are
    never touched. `progress` is called with (task, parts done, total parts, next step). Raises OutputError, before
    anything is written, if the folder is a file or cannot be written, or if it contains files of an earlier
    demonstration and `force` is not given.
    """
    folder = Path(folder)
    task, total = "demonstration", len(EXAMPLES) + 1
    make_folder(folder)
    for path in _files(folder, methods):
        if path.exists():
            check_output(path, force=force)
    try:
        progress(task, 0, total, "loading kernels")
        _warm_up(methods)
        examples: list[Example] = []
        for name in EXAMPLES:
            progress(task, len(examples) + 1, total, name)
            examples.append(_example(name, methods))
            _save(folder / name, examples[-1])
        progress(task, total, total)
    except OSError as error:
        raise OutputError(f"{folder} cannot be written: {error.strerror or error}") from error
    return examples


def draw(examples: Sequence[Example], folder: Path) -> None:
    """Write the pictures to the folder of the meshes, with one row per example.

    Raises OutputError if the folder cannot be written.
    """
    before_after = montage([_row(example) for example in examples])
    errors = montage([_row(one, errors=True) for one in examples], bar=Bar("Angle to the truth (°)", _LIMITS))
    for name, figure in ((BEFORE_AFTER, before_after), (ERRORS, errors)):
        write_atomically(folder / name, [png(pixels(figure))], force=True)


def table(examples: Sequence[Example]) -> Table:
    """Return a table of normal errors and run times, with one row per example."""
    lines = Table(caption="mean angle between the normals of the faces and the true ones")
    lines.add_column("mesh")
    for title in ("faces", "noisy", *(outcome.method for outcome in examples[0].denoised)):
        lines.add_column(title, justify="right")
    for example in examples:
        cells = [f"{outcome.angles.mean():5.2f}°  {outcome.seconds:.2f} s" for outcome in example.denoised]
        lines.add_row(example.name, str(len(example.clean.faces)), f"{example.noisy.angles.mean():.2f}°", *cells)
    return lines


def _warm_up(methods: Sequence[str]) -> None:
    """Denoise a small part of an example, so that the measured times exclude the compilation of kernels."""
    mesh = as_mesh(_DATA / "part" / "noisy.ply")
    piece = Mesh(mesh.vertices, mesh.faces[:200])
    for method in methods:
        denoise(piece, method=method)


def _example(name: str, methods: Sequence[str]) -> Example:
    noisy, clean = as_mesh(_DATA / name / "noisy.ply"), as_mesh(_DATA / name / "clean.ply")
    outcomes = []
    for method in methods:
        start = time.perf_counter()
        mesh = denoise(noisy, method=method)
        seconds = time.perf_counter() - start
        outcomes.append(Outcome(method, mesh, _angles(mesh, clean), seconds))
    return Example(name, clean, Outcome("noisy", noisy, _angles(noisy, clean), 0.0), tuple(outcomes))


def _angles(mesh: Mesh, clean: Mesh) -> NDArray[np.float64]:
    """Return (m,) angles in degrees between corresponding face normals of two meshes."""
    return np.asarray(np.degrees(angles_between(mesh.face_normals, clean.face_normals)))


def _files(folder: Path, methods: Sequence[str]) -> list[Path]:
    """Return the paths of all files that a demonstration writes."""
    meshes = [folder / name / f"{kind}.ply" for name in EXAMPLES for kind in ("clean", "noisy", *methods)]
    return [*meshes, folder / BEFORE_AFTER, folder / ERRORS]


def _save(folder: Path, example: Example) -> None:
    folder.mkdir(exist_ok=True)
    save_mesh(folder / "clean.ply", example.clean, force=True)
    for outcome in (example.noisy, *example.denoised):
        save_mesh(folder / f"{outcome.method}.ply", outcome.mesh, force=True)


def _row(example: Example, *, errors: bool = False) -> list[Panel]:
    """Draw the noisy and the denoised meshes: with their errors as colours, or beside the true shape."""
    view, panels = Camera.looking_at(example.clean, direction=EXAMPLES[example.name]), []
    for outcome in (example.noisy, *example.denoised):
        heat = HeatMap(outcome.angles, "face", _LIMITS) if errors else None
        picture = render(outcome.mesh, view=view, size=_PANEL, values=heat)
        panels.append(Panel(picture, f"{outcome.method} {outcome.angles.mean():.1f}°"))
    return panels if errors else [*panels, Panel(render(example.clean, view=view, size=_PANEL), "true shape")]
