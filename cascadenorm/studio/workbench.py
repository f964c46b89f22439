"""The open mesh with its paint and results, in the worker process."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from cascadenorm import io
from cascadenorm.api.apply import Applied, run_with_controls, step_key
from cascadenorm.api.opened_files import detected_error
from cascadenorm.api.selection import resolve_controls
from cascadenorm.compute.compile_time import Stopwatch
from cascadenorm.errors import CascadenormError, MeshError
from cascadenorm.execution.progress import Listener
from cascadenorm.io.files import beside
from cascadenorm.io.interop import mesh_of_file
from cascadenorm.mesh import Mesh, Vectors, limit_threads
from cascadenorm.registry.controls import CONTROLS, Controls, parsed_length
from cascadenorm.reports.decimation import Display, decimated
from cascadenorm.reports.given import Given
from cascadenorm.reports.scene import Comparison, viewer_scene
from cascadenorm.studio.painting import over_painted, with_paint
from cascadenorm.studio.settings import Chosen, chosen

COARSE = 1 << 15  # number of faces of a coarse mesh, which `auto` denoises in about a second
KEPT = 8  # number of cached results, which undo and redo show at once


def suggested_name(file: io.MeshFile, name: Path) -> str:
    """Return a name for the result; PLY replaces formats that cannot be written."""
    named = beside(Path(name.name), "denoised")
    try:
        io.output_format(named)
    except CascadenormError:
        return named.with_suffix(".ply").name
    return named.name


class StudioResult(NamedTuple):
    """What a method made of the mesh."""

    vertices: NDArray[Any]  # (n, 3)
    seconds: float  # how long the method took
    detected: dict[str, str | None]  # as in `KnownSteps`


@dataclass
class KnownSteps:
    """Results of a method on the whole and the coarse mesh, as for `run_with_controls`."""

    whole: list[Vectors] = field(default_factory=list)
    coarse: list[Vectors] = field(default_factory=list)
    # what `detected_error` returns, in words, None for methods other than `auto`; empty if it was not called yet
    detected: dict[str, str | None] = field(default_factory=dict)


def packed_scene(scene: Mapping[str, Any], *, faces: int | None = None) -> bytes:
    """Return the JSON of a scene; `faces` is the number of faces of the mesh that coarse ones approximate."""
    meshes = [mesh if faces is None else {**mesh, "faces": faces} for mesh in scene["meshes"]]
    return json.dumps({**scene, "meshes": meshes}, separators=(",", ":"), allow_nan=False).encode()


class Coarse(NamedTuple):
    """A decimated mesh, with the vertices and faces of the whole mesh that it keeps."""

    mesh: Mesh
    shown: Display

    def controls(self, controls: Controls, whole: Mesh) -> Controls:
        """Convert controls for the whole mesh, given as arrays, to this mesh; lengths keep their values."""
        found: dict[str, Any] = {**controls}
        for name in ("mask", "fixed"):
            if found[name] is not None:
                found[name] = np.asarray(found[name])[self.shown.kept_vertices]
        if found["only"] is not None:
            found["only"] = np.asarray(found["only"])[self.shown.kept_faces]
        for name, setting in CONTROLS.items():
            if setting.kinds == (float, str) and found[name] is not None:
                length, in_edges = parsed_length(name, found[name])
                found[name] = length * whole.mean_edge_length if in_edges else length
        return cast(Controls, found)


class Workbench:
    """One mesh file, opened.

    Its name in messages and commands is the path as the user gave it, or the name of a dropped file. Raises ReadError
    or MeshError if the file is not a mesh. Vertices that are not finite and faces without vertices are isolated
    instead.
    """

    def __init__(self, path: Path, name: str) -> None:
        self.path, self.name, self.notice = path, name, ""
        try:
            self.file = io.read(path)
        except io.ReadError as error:
            raise error.within(name) from error.__cause__
        try:
            self.mesh = mesh_of_file(self.file, name, may_isolate=True)
        except MeshError as error:
            if error.remedy is None:
                raise
            self.file = self.file.isolating()
            self.mesh, self.notice = mesh_of_file(self.file, name), error.problem
        self.target = str(Path(name).with_name(suggested_name(self.file, Path(name))))
        self.shown = decimated(self.mesh)
        self.scenes = Comparison(Given("before", self.name, self.file))
        self.paint = np.zeros(len(self.mesh.vertices), np.uint8)
        self._results: dict[str, StudioResult] = {}
        self._steps: dict[float, KnownSteps] = {}
        self._steps_key = ""

    @cached_property
    def coarse(self) -> Coarse | None:
        """The mesh of the previews; None if the mesh is small enough itself."""
        if len(self.mesh.faces) <= 2 * COARSE:
            return None
        shown = decimated(self.mesh, most=COARSE)
        return Coarse(Mesh(self.mesh.vertices[shown.kept_vertices], shown.faces), shown)

    def about(self) -> dict[str, Any]:
        """Return the properties of the file that the page shows, and its scene."""
        return {
            "name": Path(self.name).name,
            "suggested": Path(self.target).name,
            "vertices": len(self.mesh.vertices),
            "faces": len(self.mesh.faces),
            "painted": len(self.shown.kept_vertices),
            "notice": self.notice,
            "scene": packed_scene(self.scenes.first),
            "digest": self.digest,
        }

    @property
    def digest(self) -> str:
        """Digest of the file as it was read; positions and faces may lie in other files than `data`."""
        found = sha256(self.file.data)
        found.update(np.ascontiguousarray(self.file.positions).data)
        found.update(np.ascontiguousarray(self.file.polygons.corners).data)
        return found.hexdigest()

    def take_paint(self, codes: bytes) -> None:
        """Set the paint from codes of the displayed vertices; other vertices get the code of the nearest one."""
        self.paint = over_painted(codes, self.mesh, self.shown)

    def denoise(
        self, settings: dict[str, Any], listener: Listener, preview: Callable[[bytes], object]
    ) -> dict[str, Any]:
        """Denoise the mesh, a coarse one first if it is large.

        `listener` is called with the fraction done, of the coarse mesh and then of the whole one; what it raises ends
        the work. `preview` is called with a scene of the coarse mesh.
        """
        asked = self.asked(settings)
        if self.coarse is not None and self._key(settings) not in self._results and not self._steps_of(asked).whole:
            preview(self._preview(self.coarse, asked, listener))
        result = self.result(settings, listener)
        listener(1.0)
        after = self.file.with_vertices(result.vertices)
        moved = int((result.vertices != self.mesh.vertices).any(axis=1).sum())
        both = self.scenes.with_result(Given("after", self.target, after), result.vertices)
        return {"seconds": result.seconds, **result.detected, "moved": moved, "scene": packed_scene(both)}

    def asked(self, settings: dict[str, Any]) -> Chosen:
        """Return the settings with controls as arrays over the mesh, including the paint."""
        asked = chosen(settings)
        controls = asked.controls.copy()
        if self.notice:
            controls["on_bad"] = "isolate"
        return asked._replace(controls=with_paint(resolve_controls(controls, self.file), self.paint))

    def result(self, settings: dict[str, Any], listener: Listener) -> StudioResult:
        """Return the result of some settings, possibly from the cache."""
        key = self._key(settings)
        known = self._results.pop(key, None)
        if known is None:
            asked = self.asked(settings)
            watch = Stopwatch()
            applied, steps = self._controlled(asked, listener), self._steps_of(asked)
            seconds = watch.seconds()
            if applied.denoised is not None or not steps.detected:
                found = detected_error(asked.method, applied, asked.parameters)
                steps.detected = {name: None if kind is None else str(kind) for name, kind in found.items()}
            known = StudioResult(applied.vertices, seconds, steps.detected)
        self._results[key] = known
        if len(self._results) > KEPT:
            del self._results[next(iter(self._results))]
        return known

    def _controlled(self, asked: Chosen, listener: Listener) -> Applied:
        controls: Controls = {**asked.controls, "progress": listener}
        dtype = self.file.positions.dtype
        with limit_threads(controls["threads"]):
            steps = self._steps_of(asked).whole
            return run_with_controls(asked.method, self.mesh, asked.parameters, controls, dtype=dtype, steps=steps)

    def _preview(self, coarse: Coarse, asked: Chosen, listener: Listener) -> bytes:
        controls: Controls = {**coarse.controls(asked.controls, self.mesh), "progress": listener}
        with limit_threads(controls["threads"]):
            steps = self._steps_of(asked).coarse
            vertices = run_with_controls(asked.method, coarse.mesh, asked.parameters, controls, steps=steps).vertices
        before, after = (io.from_arrays(v, coarse.mesh.faces) for v in (coarse.mesh.vertices, vertices))
        meshes = [Given("before", self.name, before), Given("after", self.target, after)]
        return packed_scene(viewer_scene(meshes, []), faces=len(self.mesh.faces))

    def _key(self, settings: dict[str, Any]) -> str:
        return json.dumps(settings, sort_keys=True) + self.paint.tobytes().hex() * bool(self.paint.any())

    def _steps_of(self, asked: Chosen) -> KnownSteps:
        """Return the known results of these settings, whatever the strength, which blends them; drop all others."""
        others = {name: value for name, value in asked.given.items() if name != "strength"}
        key = self._key({"method": asked.method.name, "parameters": asked.parameters, "controls": others})
        if key != self._steps_key:
            self._steps_key, self._steps = key, {}
        step = step_key(asked.method, asked.controls["strength"])
        if step not in self._steps:
            self._steps = {one: steps for one, steps in self._steps.items() if one == 1.0} | {step: KnownSteps()}
        return self._steps[step]
