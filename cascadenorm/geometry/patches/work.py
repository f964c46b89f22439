"""Execution of work on a whole mesh or patch by patch."""

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
from cascadenorm.geometry.patches.cutting import Cutter, MeshPatch, TooNarrow, without_positions
from cascadenorm.mesh import Ints32, Mesh, Vectors

Result = TypeVar("Result")

# A face inside may have two corners in the halo, and the faces around the outermost vertices are incomplete.
HALO_MARGIN = 2  # extra width of a halo in edges beyond the receptive field of the work


@dataclass
class Patching:
    faces: int  # number of faces in a patch, including its halo
    each: Map = map  # does the work on the patches: `map` in this process, or a map over the processes of a cluster
    # bytes of memory for results that a later pass over the patches can reuse; 0 if other processes do the work
    spare: int = 0
    _cutters: dict[int, tuple[Ints32, Cutter]] = field(default_factory=dict)

    def cutter(self, mesh: Mesh, rings: int) -> Cutter:
        """Return a cutter for patches with a halo of `rings` edges; the last one of each depth is cached."""
        depth = _depth(mesh, self.faces, rings)
        known = self._cutters.get(depth)
        if known is None or known[0] is not mesh.faces:
            known = self._cutters[depth] = mesh.faces, Cutter(mesh.vertices, depth)
        return known[1]


_current: ContextVar[Patching | None] = ContextVar("patching", default=None)


@contextmanager
def working_in_patches(patching: Patching | None) -> Iterator[None]:
    """Process meshes in patches inside the block; None processes whole meshes."""
    token = _current.set(patching)
    try:
        yield
    finally:
        _current.reset(token)


def active_patching(mesh: Mesh) -> Patching | None:
    """Return the settings for work on a mesh in patches, or None if the whole mesh is processed at once."""
    patching = _current.get()
    return None if patching is None or len(mesh.faces) <= patching.faces else patching


def free_derived(*meshes: Mesh) -> None:
    """Free the cached arrays of meshes that are processed in patches; they are recomputed when needed."""
    for mesh in meshes:
        if active_patching(mesh) is not None:
            mesh.forget()


def each_patch(
    mesh: Mesh,
    patching: Patching,
    work: Callable[..., Result],
    *,
    receptive_field: int,
    facts: Sequence[str] = (),
    vertices: Sequence[NDArray[Any]] = (),
    components: bool = False,
    boxes: Sequence[int] | None = None,
) -> Iterator[tuple[MeshPatch, Result]]:
    """Apply work to each patch of a mesh, and yield each patch, without its positions, with the result.

    The work is a picklable function, called with a `MeshPatch` and its rows of the arrays `vertices`, (n, …), which it
    must not change. If it raises `TooNarrow`, it is repeated with a halo of twice the width. Its receptive field is the
    number of edges around the corners of a face that affect its result. It may also depend on `facts`, properties of
    the whole mesh such as "mean_edge_length", and on connected components. The boxes are the patches to process, by
    `MeshPatch.box`; None selects all patches.
    """
    known = {name: float(getattr(mesh, name)) for name in facts}
    labels = mesh.topology.components if components else None
    mesh.forget()
    rings = receptive_field + HALO_MARGIN
    cutter = patching.cutter(mesh, rings)
    left = list(range(cutter.count)) if boxes is None else list(boxes)
    begun = deque[MeshPatch]()

    def items(boxes: Sequence[int], rings: int) -> Iterator[tuple[Any, ...]]:
        for box in boxes:
            patch = cutter.patch(mesh, box, rings, known, labels)
            if len(patch.corners):
                begun.append(without_positions(patch))
                yield patch, *(rows[patch.vertex_numbers] for rows in vertices)
            del patch  # free its memory before the next patch is cut

    while left:
        narrow = list[int]()
        for found in patching.each(partial(_try_work, work), items(left, rings)):
            patch = begun.popleft()
            if found:
                yield patch, found.pop()
            else:
                narrow.append(patch.box)
        left, rings = narrow, 2 * rings


def face_rows(mesh: Mesh, work: Callable[..., Vectors], *, receptive_field: int, **given: Any) -> Vectors:
    """Compute a vector for each face, (m, 3), of a mesh that is processed in patches.

    The work is as in `each_patch` and returns a row for each face of the patch. Rows of faces in the halo may be wrong.
    """
    patching, out = _current.get(), np.empty(mesh.faces.shape)
    assert patching is not None
    for patch, rows in each_patch(mesh, patching, partial(_own_rows, work), receptive_field=receptive_field, **given):
        out[patch.face_numbers[patch.own]] = rows
    return out


def moved_in_patches(
    mesh: Mesh, patching: Patching, work: Callable[..., Vectors], vertices: Vectors, *, receptive_field: int
) -> Vectors:
    """Move (n, 3) vertices patch by patch; a vertex without a face stays in place.

    The work is as in `each_patch`, called with the patch, which has its `components`, and its rows of `vertices`, and
    returns their new positions, (k, 3). Positions in the halo may be wrong.
    """
    out = vertices.copy()
    inside = partial(_inside_rows, work)
    each = each_patch(mesh, patching, inside, receptive_field=receptive_field, vertices=[vertices], components=True)
    for patch, rows in each:
        out[patch.vertex_numbers[patch.inside]] = rows
    return out


def normals_by_patches(mesh: Mesh, filtered: Callable[[Mesh], Vectors], *, receptive_field: int) -> Vectors:
    """Filter face normals, (m, 3), patch by patch if requested with `working_in_patches`.

    `filtered` is a picklable function that returns the filtered normals of a mesh; a patch has the mean edge length of
    the whole mesh. Its receptive field is the number of edges around the corners of a face that affect its normal.
    """
    if active_patching(mesh) is None:
        return filtered(mesh)
    work = partial(_filter_patch, filtered)
    return face_rows(mesh, work, receptive_field=receptive_field, facts=["mean_edge_length"])


def _filter_patch(filtered: Callable[[Mesh], Vectors], patch: MeshPatch) -> Vectors:
    return filtered(patch.mesh)


def _try_work(work: Callable[..., Result], item: tuple[Any, ...]) -> list[Result]:
    """Return the result for a patch as a list, which is empty if the halo is too narrow."""
    try:
        with working_in_patches(None):
            return [work(*item)]
    except TooNarrow:
        return []


def _own_rows(work: Callable[..., Vectors], patch: MeshPatch, *values: NDArray[Any]) -> Vectors:
    return work(patch, *values)[patch.own]


def _inside_rows(work: Callable[..., Vectors], patch: MeshPatch, *values: NDArray[Any]) -> Vectors:
    return work(patch, *values)[patch.inside]


def _depth(mesh: Mesh, faces: int, rings: int) -> int:
    """Return how often a mesh must be halved so that a patch with its halo has the given number of faces.

    A square with w edges per side has w² vertices and 2 w² faces. If halos are wider than patches, a patch keeps an
    eighth of the faces inside, and its halo makes it larger than requested.
    """
    width = max((faces / 2) ** 0.5 - 2 * rings, (faces / 16) ** 0.5)
    parts = len(mesh.vertices) / width**2
    return max(0, int(np.ceil(np.log2(parts)))) if parts > 0 else 0
