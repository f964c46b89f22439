"""Denoise, measure and draw the three noisy meshes that ship with the package."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from shutil import copyfile

from numpy.typing import ArrayLike

from cascadenorm.evaluation.harness import Evaluation, evaluate
from cascadenorm.evaluation.runs import NOISY
from cascadenorm.execution.progress import Progress, no_progress
from cascadenorm.io.atomic import check_output, make_folder, write_atomically
from cascadenorm.io.interop import as_mesh
from cascadenorm.io.pairs import FilePair
from cascadenorm.mesh import Mesh
from cascadenorm.render import Bar, Panel, montage, pixels, png
from cascadenorm.render.scenes import Style, one_view, panels, scene

EXAMPLES: dict[str, ArrayLike | None] = {"part": (0.45, 0.4, 0.8), "head": (0.15, 0.15, 1), "scan": None}
"""Name of each example, and the direction from the mesh to the viewer."""

METHODS = ("bilateral-normal", "cascade", "auto")
FOLDER = Path("cascadenorm-demo")
BEFORE_AFTER, ERRORS = "before-after.png", "errors.png"

_DATA = Path(__file__).parent.parent / "demo_data"
_LIMITS = (0.0, 20.0)  # degrees; range of the error colours


def demo(
    folder: str | PathLike[str] = FOLDER,
    *,
    methods: Sequence[str] = METHODS,
    force: bool = False,
    progress: Progress = no_progress,
) -> Evaluation:
    """Evaluate methods with their default parameters on the examples, and keep the meshes in a folder.

    `force` replaces files of an earlier demonstration; other files are never touched. `progress` is that of `evaluate`.
    Raises OutputError, before anything is written, if the folder is a file or cannot be written, or if it contains
    files of an earlier demonstration and `force` is not given.
    """
    folder = Path(folder)
    make_folder(folder)
    rows = [folder / name / kind for name in EXAMPLES for kind in (NOISY, *methods)]
    truths = [folder / name / "clean.ply" for name in EXAMPLES]
    meshes = [row.with_name(f"{row.name}.ply") for row in rows]
    written = [*truths, *meshes, folder / BEFORE_AFTER, folder / ERRORS]
    for path in filter(Path.exists, written):
        check_output(path, force=force)
    for path in (*written, *(mesh.with_suffix(".json") for mesh in meshes)):
        path.unlink(missing_ok=True)
    pairs = [FilePair(name, _DATA / name / "noisy.ply", _DATA / name / "clean.ply") for name in EXAMPLES]
    done = evaluate(pairs, methods=methods, keep=folder, progress=progress)
    for failure in done.failures:
        raise failure.error
    for pair, truth in zip(pairs, truths, strict=True):
        copyfile(pair.clean, truth)
    return done


def draw_demo(done: Evaluation, folder: Path) -> None:
    """Write the pictures to a folder, with one row per example: the meshes and the true shape, and the errors.

    Raises OutputError if the folder cannot be written.
    """
    shown, errors = zip(*_rows(done), strict=True)
    figures = montage(shown), montage(errors, bar=Bar("Angle to the truth (°)", _LIMITS))
    for name, figure in zip((BEFORE_AFTER, ERRORS), figures, strict=True):
        write_atomically(folder / name, [png(pixels(figure))], force=True)


def _rows(done: Evaluation) -> Iterator[tuple[list[Panel], list[Panel]]]:
    """Yield the panels of each example: the noisy, denoised and true meshes, and all but the last with their errors."""
    for pair in done.pairs:
        *meshes, clean = example_meshes(done, pair)
        angles = (one.measures.normal_error_deg for one in done.results if one.pair == pair.name)
        captions = [f"{method} {angle:.1f}°" for method, angle in zip(done.methods, angles, strict=True)]
        style = Style(size=400, direction=EXAMPLES[pair.name])
        plain = scene([*meshes, clean], [*captions, "true shape"], style)
        colored = scene(meshes, done.methods, replace(style, values="normal-error", reference=clean, limits=_LIMITS))
        views = one_view(plain)
        yield panels(plain, views), panels(colored, views[:-1])


def example_meshes(done: Evaluation, pair: FilePair) -> list[Mesh]:
    """Return the noisy mesh of an example, those of the methods, and the true one."""
    assert done.records is not None
    files = [done.records.mesh_file(pair.name, method) for method in done.methods]
    return [as_mesh(file) for file in (*files, pair.clean)]
