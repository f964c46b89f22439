"""Passes over the patches of a mesh on disk, each of which goes on where it was interrupted."""

import io
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.api.halo import as_part
from cascadenorm.detection.parts import Found, Measure, Part
from cascadenorm.execution.process_map import Map
from cascadenorm.execution.progress import Listener
from cascadenorm.io.atomic import write_atomically
from cascadenorm.mesh import Floats, Ints, Mesh, Vectors
from cascadenorm.streaming.components import write_components
from cascadenorm.streaming.layers import Layer
from cascadenorm.streaming.patch_files import write_missing
from cascadenorm.streaming.store import Store, StoredPatch

VECTOR = np.dtype(("f8", (3,)))


class TooNarrow(Exception):
    """The halo of a patch does not hold all that work on it depends on."""


class Steps(NamedTuple):
    """A method as passes over the patches.

    Parameters
    ----------
    take : does the passes; returns what gives the result on a patch with a halo of any width, in the frame
    cost : of all passes, for the progress
    weights : digest of the networks, if it has some
    """

    take: "Callable[[Passes], Callable[[View], Vectors]]"
    cost: float
    weights: str = ""


class View:
    """A patch as methods see it: in the frame, oriented, with what they need to know of the whole.

    Parameters
    ----------
    components : (c,) numbers in the whole of its connected components, which `Passes` has written
    mesh : of the patch with its halo
    """

    def __init__(self, store: Store, number: int, stored: StoredPatch) -> None:
        self._stored, self._tiles = stored, store.tiles_of(number)
        labels, whole = _component(store).read(stored.tiles, stored.vertex_rows), store.whole
        self.components, local = np.unique(labels, return_inverse=True)
        self.mesh = as_part(
            Mesh(stored.positions, stored.patch.faces),
            stored.patch.halo.whole,
            local.astype(np.int32),
            median_edge_length=whole.median_edge_length,
            diagonal=whole.diagonal,
        )
        self.patch = stored.patch

    @property
    def part(self) -> Part:
        """The mesh as a part of the whole."""
        return Part(self.mesh, ~self.patch.halo.vertices, self.components)

    @property
    def complete(self) -> NDArray[np.bool_]:
        """(k,) vertices of which all faces are here."""
        return np.asarray(self.mesh.topology.vertex_faces.counts == self.patch.halo.whole.around)

    def mesh_at(self, positions: Layer | None, **facts: float) -> Mesh:
        """Return the mesh with other positions, and facts about the whole with these; None: as it was given."""
        return self.mesh.moved(self.vertices(positions)).with_facts(**facts)

    def edge_lengths(self, mesh: Mesh) -> Floats:
        """Return the lengths of the edges of the part in the mesh with some positions."""
        ends = mesh.vertices[mesh.topology.edges[self.part.edges]]
        return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1))

    def vertices(self, positions: Layer | None) -> Vectors:
        """Return positions of its vertices, (k, 3); None: as they were given."""
        return self.mesh.vertices if positions is None else self.of_vertices(positions)

    def of_vertices(self, layer: Layer) -> NDArray[Any]:
        """Return what its vertices have in a layer, (k, …)."""
        return layer.read(self._stored.tiles, self._stored.vertex_rows)

    def of_faces(self, layer: Layer) -> NDArray[Any]:
        """Return what its faces have in a layer, (j, …)."""
        return layer.read(self._stored.tiles, self._stored.face_rows)

    def keep_vertices(self, layer: Layer, values: NDArray[Any]) -> None:
        """Write the values, of (k, …), of the vertices that are not in the halo."""
        layer.write(*self._tiles, values[self._stored.own_vertices])

    def keep_faces(self, layer: Layer, values: NDArray[Any]) -> None:
        """Write the values, of (j, …), of the faces at these vertices."""
        layer.write(*self._tiles, values[self._stored.own_faces])

    def keep_faces_once(self, layer: Layer, values: NDArray[Any]) -> None:
        """Write the values, of (j, …), of the faces of the part, each to one row of the layer; other rows are zero."""
        first = np.unique(self._stored.own_faces, return_index=True)[1]
        rows = np.zeros((len(self._stored.own_faces), *values.shape[1:]), values.dtype)
        rows[first] = np.where(self.part.faces, values, 0)[self._stored.own_faces[first]]
        layer.write(*self._tiles, rows)


class Results:
    """What a pass found in each patch, on disk."""

    def __init__(self, paths: list[Path]) -> None:
        self._paths = paths

    def __iter__(self) -> Iterator[tuple[Ints, Found]]:
        """Return of each patch that has faces the numbers of its components, and what was found."""
        for path in self._paths:
            with np.load(path) as kept:
                found = dict(kept)
            if found:
                yield found.pop("components"), found


class Passes:
    """Passes over the patches of a mesh on disk.

    Parameters
    ----------
    folder : where results are kept
    each : does the work on the patches of a pass
    progress : is told which part of the total cost is spent
    """

    def __init__(self, store: Store, folder: Path, each: Map, progress: Listener | None, cost: float) -> None:
        self.store, self.folder, self._each, self._progress, self._cost = store, folder, each, progress, cost
        self._spent = 0.0
        path = folder / "components.txt"
        if not path.exists():
            write_atomically(path, [str(write_components(store, _component(store))).encode()])
        self.components = int(path.read_text(encoding="ascii"))
        """How many connected components the mesh has."""

    def each(self, name: str, rings: int, measure: Measure) -> Results:
        """Measure each patch, as `detection.parts.Surface` has it."""
        return self.run(name, rings, lambda view: measure(view.part))

    def run(self, name: str, rings: int, work: Callable[[View], Found | None], cost: float = 0.0) -> Results:
        """Work on each patch that is not done yet.

        Parameters
        ----------
        name : of the pass
        rings : width of the halo
        work : what is done with a patch; it may be repeated after an interruption, and for patches on which it raises
            TooNarrow it is, with a halo of twice the width
        cost : of the pass
        """
        count = self.store.whole.patches
        paths = [self.folder / f"{name.replace(' ', '_')}_{number}.npz" for number in range(count)]
        for done in write_missing(paths, partial(_found, self.store, rings, work), self._each):
            if self._progress is not None and cost > 0:
                self._progress(min(1.0, (self._spent + cost * done / count) / self._cost))
        self._spent += cost
        return Results(paths)

    def normals(self, name: str) -> Layer:
        """Return normals of all faces, under a name."""
        return self.store.face_layer(f"{name} normals".replace(" ", "_"), VECTOR)

    def positions(self, name: str) -> Layer:
        """Return positions of all vertices, in the frame, under a name."""
        return self.store.vertex_layer(name.replace(" ", "_"), VECTOR)


def _component(store: Store) -> Layer:
    """Return the connected component of each vertex."""
    return store.vertex_layer("component", np.int32)


def _found(store: Store, rings: int, work: Callable[[View], Found | None], number: int) -> bytes:
    """Work on a patch, with a wider halo where it needs one; return what was found, as a file."""
    found: dict[str, Any] = {}
    while len((stored := store.patch(number, rings)).own_faces):
        view = View(store, number, stored)
        try:
            found = {**(work(view) or {}), "components": view.components}
            break
        except TooNarrow:
            rings *= 2
    content = io.BytesIO()
    np.savez(content, **found)
    return content.getvalue()
