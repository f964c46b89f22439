"""Work on one patch of a mesh after the other where `working_in_patches` asks for it, else on the whole mesh."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cascadenorm.execution.process_map import Map
from cascadenorm.mesh import Ints32, Mesh, Vectors
from cascadenorm.patches.cutting import Cutter, MeshPatch, TooNarrow, lighter

Result = TypeVar("Result")

EXTRA = 2
"""Edges by which a halo is wider than the reach of the work: a face inside may have two corners in the halo, and the
faces around the outermost vertices are not complete."""


@dataclass
class Patching:
    """How work is cut into patches.

    Parameters
    ----------
    faces
        Number of faces in a patch, those of its halo included.
    each
        Does the work on the patches: `map` in this process, or another map in the processes of a cluster.
    spare
        Bytes of memory for results that a later pass over the patches can reuse; 0 where other processes do the work.
    """

    faces: int
    each: Map = map
    spare: int = 0
    _cutters: dict[int, tuple[Ints32, Cutter]] = field(default_factory=dict)

    def cutter(self, mesh: Mesh, rings: int) -> Cutter:
        """Return what cuts a mesh into patches with a halo of so many edges; the last one of each depth is kept."""
        depth = _depth(mesh, self.faces, rings)
        known = self._cutters.get(depth)
        if known is None or known[0] is not mesh.faces:
            known = self._cutters[depth] = mesh.faces, Cutter(mesh.vertices, depth)
        return known[1]


_current: ContextVar[Patching | None] = ContextVar("patching", default=None)


@contextmanager
def working_in_patches(patching: Patching | None) -> Iterator[None]:
    """Let work inside the block be done in patches; None lets it be done on whole meshes."""
    token = _current.set(patching)
    try:
        yield
    finally:
        _current.reset(token)


def patching_of(mesh: Mesh) -> Patching | None:
    """Return how work on a mesh is cut, or None if it is done on the whole mesh."""
    patching = _current.get()
    return None if patching is None or len(mesh.faces) <= patching.faces else patching


def free_derived(*meshes: Mesh) -> None:
    """Free the arrays that were derived from meshes where work is done in patches, until they are needed again."""
    for mesh in meshes:
        if patching_of(mesh) is not None:
            mesh.forget()


def each_patch(
    mesh: Mesh,
    patching: Patching,
    work: Callable[..., Result],
    *,
    reach: int,
    facts: Sequence[str] = (),
    vertices: Sequence[NDArray[Any]] = (),
    faces: Sequence[NDArray[Any]] = (),
    components: bool = False,
    boxes: Sequence[int] | None = None,
) -> Iterator[tuple[MeshPatch, Result]]:
    """Do work on each patch of a mesh and yield each patch, without its positions, with the result.

    Parameters
    ----------
    mesh
        Mesh with n vertices and m faces.
    work
        Called with a `MeshPatch` and its rows of `vertices` and `faces`. It can be pickled, and does not change them.
        It is repeated with a wider halo where it raises `TooNarrow`.
    reach
        Number of edges around the corners of a face within which the mesh decides on the result for that face.
    facts
        Properties of the whole mesh that the work depends on, such as "mean_edge_length".
    vertices, faces
        (n, …) and (m, …) further values.
    components
        Whether the work depends on connected components.
    boxes
        Patches that are worked on, by `MeshPatch.box`; None for all.
    """
    known = {name: float(getattr(mesh, name)) for name in facts}
    labels = mesh.topology.components if components else None
    mesh.forget()
    rings = reach + EXTRA
    cutter = patching.cutter(mesh, rings)
    left = list(range(cutter.count)) if boxes is None else list(boxes)
    begun = deque[MeshPatch]()

    def items(boxes: Sequence[int], rings: int) -> Iterator[tuple[Any, ...]]:
        for box in boxes:
            patch = cutter.patch(mesh, box, rings, known, labels)
            if len(patch.corners):
                begun.append(lighter(patch))
                ids, numbers = patch.vertex_numbers, patch.face_numbers
                yield patch, *(rows[ids] for rows in vertices), *(rows[numbers] for rows in faces)
            del patch  # and what was derived from them, before the next patch is cut

    while left:
        narrow = list[int]()
        for found in patching.each(partial(_done, work), items(left, rings)):
            patch = begun.popleft()
            if found:
                yield patch, found.pop()
            else:
                narrow.append(patch.box)
        left, rings = narrow, 2 * rings


def rows_of_faces(mesh: Mesh, work: Callable[..., NDArray[Any]], *, reach: int, **given: Any) -> NDArray[Any]:
    """Compute a row for each face, patch by patch where that is asked for.

    Parameters
    ----------
    mesh
        Mesh with m faces.
    work
        As in `each_patch`; returns a row for each face of the patch, that of a face in the halo may be wrong.
    reach, given
        As in `each_patch`.

    Returns
    -------
    (m, …)
    """
    patching = patching_of(mesh)
    if patching is None:
        return work(MeshPatch.whole(mesh), *given.get("vertices", ()), *given.get("faces", ()))
    out: NDArray[Any] | None = None
    for patch, rows in each_patch(mesh, patching, partial(_own_rows, work), reach=reach, **given):
        if out is None:
            out = np.empty((len(mesh.faces), *rows.shape[1:]), rows.dtype)
        out[patch.face_numbers[patch.own]] = rows
    assert out is not None
    return out


def moved_in_patches(
    mesh: Mesh, patching: Patching, work: Callable[..., Vectors], vertices: Vectors, *, reach: int, components: bool
) -> Vectors:
    """Move vertices patch by patch.

    Parameters
    ----------
    mesh
        Mesh with n vertices.
    work
        As in `each_patch`, called with the patch and its rows of `vertices`; returns where they go, (k, 3), of which
        those in the halo may be wrong.
    vertices
        (n, 3) positions before; a vertex without a face stays there.
    reach, components
        As in `each_patch`.

    Returns
    -------
    (n, 3)
    """
    out = vertices.copy()
    inside = partial(_inside_rows, work)
    each = each_patch(mesh, patching, inside, reach=reach, vertices=[vertices], components=components)
    for patch, rows in each:
        out[patch.vertex_numbers[patch.inside]] = rows
    return out


def normals_by_patches(mesh: Mesh, filtered: Callable[[Mesh], Vectors], *, reach: int) -> Vectors:
    """Filter face normals, patch by patch where that is asked for.

    Parameters
    ----------
    mesh
        Mesh with m faces.
    filtered
        Returns the filtered normals of a mesh, of which it knows the mean edge length of the whole; can be pickled.
    reach
        Number of edges around the corners of a face within which the mesh decides on its filtered normal.

    Returns
    -------
    (m, 3)
    """
    return rows_of_faces(mesh, partial(_of_mesh, filtered), reach=reach, facts=["mean_edge_length"])


def _of_mesh(filtered: Callable[[Mesh], Vectors], patch: MeshPatch) -> Vectors:
    return filtered(patch.mesh)


def _done(work: Callable[..., Result], item: tuple[Any, ...]) -> list[Result]:
    """Return the result for a patch in a list, which is empty if its halo is too narrow."""
    try:
        with working_in_patches(None):
            return [work(*item)]
    except TooNarrow:
        return []


def _own_rows(work: Callable[..., NDArray[Any]], patch: MeshPatch, *values: NDArray[Any]) -> NDArray[Any]:
    return work(patch, *values)[patch.own]


def _inside_rows(work: Callable[..., Vectors], patch: MeshPatch, *values: NDArray[Any]) -> Vectors:
    return work(patch, *values)[patch.inside]


def _depth(mesh: Mesh, faces: int, rings: int) -> int:
    """Return how often a mesh is halved so that a patch has so many faces with its halo.

    A square of w edges a side has w² vertices and 2 w² faces. Where halos are wider than patches, a patch keeps an
    eighth of the faces inside, and its halo makes it larger.
    """
    width = max((faces / 2) ** 0.5 - 2 * rings, (faces / 16) ** 0.5)
    parts = len(mesh.vertices) / width**2
    return max(0, int(np.ceil(np.log2(parts)))) if parts > 0 else 0
