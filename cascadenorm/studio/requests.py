"""Requests about the open mesh, answered in the worker process, such as to save a result or to tell its commands."""

from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
from numpy.typing import NDArray

from cascadenorm import io
from cascadenorm.api.apply import Applied, reported_controls
from cascadenorm.api.dropped_components import Dropped
from cascadenorm.api.opened_files import Opened, written_file
from cascadenorm.errors import CascadenormError, MeshError, OutputError, ReadError
from cascadenorm.execution.progress import Listener
from cascadenorm.io.atomic import check_output
from cascadenorm.io.files import is_mesh_name
from cascadenorm.io.sidecar_files import file_beside
from cascadenorm.registry.controls import Controls
from cascadenorm.reports.facts import Recipe, command_line, python_call
from cascadenorm.studio.painting import has_paint
from cascadenorm.studio.settings import Chosen, form
from cascadenorm.studio.workbench import Workbench


def save(
    bench: Workbench, settings: dict[str, Any], target: Path, listener: Listener, *, force: bool
) -> dict[str, Any]:
    """Write the result and the paint beside it, both or neither.

    Returns `file`, the path as it was given; `files`, the absolute paths of all files that were written; `left_out`,
    what the format cannot hold, in words; and `command` and `python`, text that makes the file again. Raises
    OutputError if a file exists and force is not given, it cannot be written, its name has no extension, or it is the
    opened file.
    """
    asked, result = bench.asked(settings), bench.result(settings, listener)
    painted = _painted(bench, asked, target)
    format = io.output_format(target.name)
    sidecars = bench.file.may_write(target) if format == bench.file.format else ()
    paths = list(dict.fromkeys([target, *(path for path, _ in painted.values()), *sidecars]))
    for path in paths:
        check_output(path, force=True)
        _check_not_opened(bench, path)
    existing = [path.name for path in paths if path.is_file()]
    if existing and not force:
        problem = f"{' and '.join(existing)} {'exists' if len(existing) == 1 else 'exist'} already"
        raise OutputError(problem, hint="choose another name", remedy=("force", True), existing=existing)
    opened = Opened(bench.path, target, format, bench.file, bench.mesh, asked.controls, Dropped(bench.file))
    done = written_file(
        opened,
        Applied.elsewhere(bench.mesh, result.vertices),  # the page has told the kind of error already
        asked.method,
        asked.parameters,
        asked.controls,
        seconds=result.seconds,
        force=force,
        others={path: [_npy(values)] for path, values in painted.values()},
    )
    files = [str(path.absolute()) for path in paths if path.is_file()]
    about = {"file": str(target), "files": files, "left_out": list(done.summary.left_out)}
    return {**about, **recipe(bench, settings, target)}


def download(bench: Workbench, settings: dict[str, Any], name: str, listener: Listener) -> dict[str, Any]:
    """Return the result of `save` with the bytes of the file, or of a ZIP file, and the names of all `files`."""
    with TemporaryDirectory() as folder:
        done = save(bench, settings, Path(folder) / name, listener, force=False)
        files = sorted(path for path in Path(folder).rglob("*") if path.is_file())
        if len(files) == 1:
            content = files[0].read_bytes()
        else:
            name, stream = f"{Path(name).stem}.zip", BytesIO()
            with ZipFile(stream, "w", ZIP_DEFLATED) as archive:
                for path in files:
                    archive.write(path, path.relative_to(folder))
            content = stream.getvalue()
    names = [path.relative_to(folder).as_posix() for path in files]
    made = recipe(bench, settings, Path(done["file"]).relative_to(folder))
    return {**done, **made, "name": name, "files": names, "content": content}


def recipe(bench: Workbench, settings: dict[str, Any], target: Path) -> dict[str, Any]:
    """Return the `command` line and the `python` call that reproduce a file, and the `painted` files they read."""
    io.output_format(target.name)
    asked = bench.asked(settings)
    files = {name: str(path) for name, (path, _) in _painted(bench, asked, target).items()}
    named = {**asked.controls, **{name: asked.given.get(name) for name in ("mask", "fixed", "only")}, **files}
    controls = reported_controls(cast(Controls, named))
    made = Recipe(bench.name, str(target), asked.method.name, asked.parameters, asked.controls["strength"], controls)
    painted = [Path(path).name for path in files.values()]
    return {"command": command_line(made), "python": python_call(made), "painted": painted}


def _check_not_opened(bench: Workbench, path: Path) -> None:
    """Raise OutputError for the opened file and the files it refers to, which commands and a new process read again."""
    beside = (file_beside(bench.path.parent, name) for name in bench.file.refers_to())
    own = [bench.path, Path(bench.name), *(found for found in beside if found is not None)]
    if any(path.absolute() == one.absolute() or _same_file(path, one) for one in own):
        problem = f"{path.name} is the opened file, or a part of it, and the studio keeps it"
        raise OutputError(problem, hint="choose another name")


def _same_file(one: Path, other: Path) -> bool:
    """Test whether two names are of one file, such as a link, or another case where that makes no difference."""
    return one.exists() and other.exists() and one.samefile(other)


def _painted(bench: Workbench, asked: Chosen, target: Path) -> dict[str, tuple[Path, NDArray[Any]]]:
    """Return the painted controls, each as a path and an array over the vertices of the file."""
    welds = bench.file.welds
    arrays = {name: asked.controls[name] for name, drawn in has_paint(bench.paint).items() if drawn}  # type: ignore[literal-required]
    return {
        name: (target.with_name(f"{target.stem}_{name}.npy"), np.asarray(array)[welds])
        for name, array in arrays.items()
    }


def _npy(values: NDArray[Any]) -> bytes:
    stream = BytesIO()
    np.save(stream, values, allow_pickle=False)
    return stream.getvalue()


class Requests:
    """Handlers of the requests, called one after another."""

    def __init__(self) -> None:
        self._opened: Workbench | None = None
        self._lost: CascadenormError | None = None  # why the mesh of an earlier process could not be opened again

    @property
    def _bench(self) -> Workbench:
        if self._opened is None:
            if self._lost is not None:
                raise self._lost
            raise MeshError("no mesh is open", hint="open one")
        return self._opened

    def done(self, kind: str, given: dict[str, Any], listener: Listener, preview: Callable[[bytes], object]) -> Any:
        """Handle a request of a kind with the given arguments.

        "form" describes the methods; "which" of several file names is a mesh, by its number; "open" opens a mesh, and
        "reopen" that of an earlier process; of the open one there are "paint", "denoise", "save", "download" and
        "recipe". `listener` is called with the fraction done, and `preview` with the scene of a coarse mesh.
        """
        match kind:
            case "form":
                return form()
            case "which":
                return next((i for i, name in enumerate(given["names"]) if is_mesh_name(Path(name))), 0)
            case "open":
                self._opened = Workbench(Path(given["path"]), given["name"])
                return self._opened.about()
            case "reopen":
                return self._reopen(Path(given["path"]), given["name"], given["digest"])
            case "paint":
                return self._bench.take_paint(given["codes"])
            case "denoise":
                return self._bench.denoise(given["settings"], listener, preview)
            case "save":
                target = Path(given["target"])
                return save(self._bench, given["settings"], target, listener, force=given["force"])
            case "download":
                return download(self._bench, given["settings"], given["name"], listener)
            case "recipe":
                _check_not_opened(self._bench, Path(given["target"]))
                return recipe(self._bench, given["settings"], Path(given["target"]))
        raise ValueError(kind)

    def _reopen(self, path: Path, name: str, digest: str) -> None:
        """Open the mesh that the page shows; if its file has changed, all requests about it fail."""
        try:
            bench = Workbench(path, name)
            if bench.digest != digest:
                raise ReadError(f"{name} has changed since it was opened", hint="start the studio again")
        except CascadenormError as error:
            self._lost = error
            raise
        self._opened = bench
