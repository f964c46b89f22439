"""Partition of a mesh into compact patches with halos."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cascadenorm.geometry.neighborhoods import steps_from
from cascadenorm.mesh import Bools, Csr, Index, Ints, Ints32, Mesh, Vectors, doubled, kernel, marked


class TooNarrow(Exception):
    """Raised if a result depends on faces beyond the halo; the work is repeated with a wider halo."""


@dataclass(frozen=True, eq=False)
class MeshPatch:
    """A part of a mesh with a halo, as sent to the process that works on it."""

    vertices: Vectors  # (k, 3) positions
    corners: Ints32  # (j, 3) faces as indices of `vertices`
    box: int  # index of the box that the patch was grown from (see `Cutter`)
    # vertex_numbers, face_numbers: (k,) and (j,) indices of the vertices and faces in the whole mesh, ascending
    vertex_numbers: Ints32
    face_numbers: Ints32
    inside: Bools  # (k,) whether each vertex is outside the halo
    complete: Bools  # (k,) whether the patch contains all faces of the whole mesh around each vertex
    facts: Mapping[str, float]  # properties of the whole mesh for `Mesh.with_facts`
    # (k,) connected component of each vertex in the whole mesh; None if the work does not need it
    components: Ints32 | None = None

    @cached_property
    def mesh(self) -> Mesh:
        """The patch as a mesh with the facts and components of the whole mesh."""
        mesh = Mesh(self.vertices, self.corners).with_facts(**self.facts)
        if self.components is not None:
            local = np.searchsorted(self.component_numbers, self.components)
            mesh.topology.__dict__["components"] = local.astype(np.int32)
        return mesh

    @cached_property
    def component_numbers(self) -> Ints32:
        """(c,) components of the whole mesh that occur in the patch, ascending."""
        assert self.components is not None
        return np.unique(self.components)

    @property
    def own(self) -> Bools:
        """(j,) whether each face belongs to this patch: its first corner is inside."""
        return np.asarray(self.inside[self.corners[:, 0]])

    def check_complete(self, faces: Bools) -> None:
        """Raise TooNarrow unless the patch contains all faces of the whole mesh around the given faces, (j,) bool."""
        if not self.complete[self.corners[faces]].all():
            raise TooNarrow

    def narrowed(self, rings: int) -> tuple["MeshPatch", Ints]:
        """Return the patch with a halo of only `rings` edges, and the indices of its faces in this patch."""
        near = steps_from(self.mesh.topology, self.inside, rings) <= rings
        faces = np.flatnonzero(near[self.corners].all(axis=1))
        corners = (np.cumsum(near, dtype=np.int32) - 1)[self.corners[faces]]
        counts = self.mesh.topology.vertex_faces.counts[near]
        complete = self.complete[near] & (np.bincount(corners.ravel(), minlength=len(counts)) == counts)
        components = None if self.components is None else self.components[near]
        narrow = replace(
            self, vertices=self.vertices[near], corners=corners, vertex_numbers=self.vertex_numbers[near],
            face_numbers=self.face_numbers[faces], inside=self.inside[near], complete=complete, components=components,
        )  # fmt: skip
        return narrow, faces


class Cutter:
    """Boxes with equal numbers of the (n, 3) points, from which patches are grown.

    Boxes are halved `depth` times across their longest side, which gives 2**depth boxes.
    """

    def __init__(self, points: Vectors, depth: int) -> None:
        self.count = 1 << depth
        self._boxes = _halved(points, np.arange(len(points), dtype=np.int32), depth)
        self._place = np.full(len(points), -1, np.int32)

    def patch(
        self, mesh: Mesh, number: int, rings: int, facts: Mapping[str, float], components: Ints32 | None
    ) -> MeshPatch:
        """Return the patch of a box, 0 … `count` - 1, with a halo of some rings of edges.

        The mesh may have moved since the boxes were created. `facts` and `components`, (n,), are as in `MeshPatch`.
        """
        faces, around, place = mesh.faces, mesh.topology.vertex_faces, self._place
        seeds = self._boxes[number]
        seeds = seeds[around.indptr[seeds + 1] > around.indptr[seeds]]  # vertices without a face belong to no patch
        near = _grown(faces, around, seeds, rings, place)
        near.sort()
        place[near] = np.arange(len(near), dtype=np.int32)
        numbers = _faces_between(faces, around, near, place)
        numbers.sort()
        corners, inside = place[faces[numbers]], marked(place[seeds], len(near))
        place[near] = -1
        complete = np.bincount(corners.ravel(), minlength=len(near)) == around.indptr[near + 1] - around.indptr[near]
        of_here = None if components is None else components[near]
        return MeshPatch(mesh.vertices[near], corners, number, near, numbers, inside, complete, facts, of_here)


def without_positions(patch: MeshPatch) -> MeshPatch:
    """Return a patch without its positions, with only the data needed to store its results."""
    return replace(patch, vertices=patch.vertices[:0], complete=patch.complete[:0])


def _halved(points: Vectors, order: Ints32, depth: int) -> list[Ints32]:
    """Return the point indices `order` in 2**depth parts, one for each box; they are reordered in place."""
    if depth == 0:
        return [order]
    mine = points[order]
    along = mine[:, int(np.argmax(np.ptp(mine, axis=0)))] if len(mine) else mine[:, 0]
    middle = len(order) // 2
    if len(order) > 1:
        order[:] = order[np.argpartition(along, middle)]
    del mine, along
    return [*_halved(points, order[:middle], depth - 1), *_halved(points, order[middle:], depth - 1)]


@kernel
def _grown(faces: Ints32, around: Csr, seeds: Ints32, rings: int, place: Ints32) -> Ints32:
    """Return the vertices within `rings` of the seeds, and set their `place` from -1 to 0."""
    found = np.empty(2 * len(seeds) + 64, np.int32)
    found[: len(seeds)] = seeds
    first, end = 0, len(seeds)
    for i in range(end):
        place[found[i]] = 0
    for _ in range(rings):
        last = end
        for i in range(first, last):
            for k in range(around.indptr[found[i]], around.indptr[found[i] + 1]):
                for corner in range(3):
                    other = faces[around.indices[k], corner]
                    if place[other] < 0:
                        place[other] = 0
                        if end == len(found):
                            found = doubled(found)
                        found[end] = other
                        end += 1
        first = last
    return found[:end].copy()


@kernel
def _faces_between(faces: Ints32, around: Csr, vertices: Ints32, place: Ints32) -> Ints32:
    """Return the faces with all corners among the given vertices, which are those with a `place`."""
    found = np.empty(2 * len(vertices) + 64, np.int32)
    end = 0
    for v in vertices:
        before: Index = np.int64(-1)
        for k in range(around.indptr[v], around.indptr[v + 1]):
            f = np.int64(around.indices[k])
            if f == before or faces[f, 0] != v or place[faces[f, 1]] < 0 or place[faces[f, 2]] < 0:
                continue
            before = f
            if end == len(found):
                found = doubled(found)
            found[end] = f
            end += 1
    return found[:end].copy()
