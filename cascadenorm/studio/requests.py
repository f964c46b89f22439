"""Requests about the open mesh, answered in the worker process."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from cascadenorm.errors import MeshError
from cascadenorm.execution.progress import Listener
from cascadenorm.io.files import is_mesh_name
from cascadenorm.studio import saving
from cascadenorm.studio.settings import form
from cascadenorm.studio.workbench import Workbench


class Requests:
    """Handlers of the requests, called one after another."""

    def __init__(self) -> None:
        self._opened: Workbench | None = None

    @property
    def _bench(self) -> Workbench:
        if self._opened is None:
            raise MeshError("no mesh is open", hint="open one")
        return self._opened

    def done(self, kind: str, given: dict[str, Any], listener: Listener, preview: Callable[[bytes], object]) -> Any:
        """Handle a request of a kind with the given arguments.

        "form" describes the methods; "which" of several file names is a mesh, by its number; "open" opens a mesh; of
        the open one there are "paint", "denoise", "save", "download" and "recipe". `listener` is called with the
        fraction done, and `preview` with the scene of a coarse mesh.
        """
        match kind:
            case "form":
                return form()
            case "which":
                return next((i for i, name in enumerate(given["names"]) if is_mesh_name(Path(name))), 0)
            case "open":
                self._opened = Workbench(Path(given["path"]), given["name"])
                return self._opened.about()
            case "paint":
                return self._bench.take_paint(given["codes"])
            case "denoise":
                return self._bench.denoise(given["settings"], listener, preview)
            case "save":
                target = Path(given["target"])
                return saving.save(self._bench, given["settings"], target, listener, force=given["force"])
            case "download":
                return saving.packed(self._bench, given["settings"], given["name"], listener)
            case "recipe":
                return saving.recipe(self._bench, given["settings"], Path(given["target"]))
        raise ValueError(kind)
