"""A mesh cut into compact patches, each with a halo of what surrounds it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from cascadenorm.geometry.neighborhoods import steps_from
from cascadenorm.mesh import Bools, Csr, Index, Ints, Ints32, Mesh, Vectors, doubled, kernel


class TooNarrow(Exception):
    """Raised by work whose result depends on faces beyond the halo; it is repeated with a halo of twice the width."""


@dataclass(frozen=True, eq=False)
class MeshPatch:
    """A part of a mesh with a halo around it, as it is sent to the process that works on it.

    Parameters
    ----------
    vertices
        (k, 3) positions.
    corners
        (j, 3) corners of the faces, by rows of `vertices`.
    box
        Number of the box that the patch was grown from, see `Cutter`.
    vertex_numbers, face_numbers
        (k,) and (j,) ascending numbers of the vertices and faces in the whole mesh.
    inside
        (k,) vertices that are not in the halo.
    complete
        (k,) vertices that have all faces of the whole mesh around them.
    facts
        Facts about the whole mesh, as `Mesh.with_facts` takes them.
    components
        (k,) connected component of each vertex in the whole mesh, or None if the work does not need them.
    """

    vertices: Vectors
    corners: Ints32
    box: int
    vertex_numbers: Ints32
    face_numbers: Ints32
    inside: Bools
    complete: Bools
    facts: Mapping[str, float]
    components: Ints32 | None = None

    @cached_property
    def mesh(self) -> Mesh:
        """The patch as a mesh that has the facts and components of the whole mesh in place of its own."""
        mesh = Mesh(self.vertices, self.corners).with_facts(**self.facts)
        if self.components is not None:
            local = np.searchsorted(self.component_numbers, self.components)
            mesh.topology.__dict__["components"] = local.astype(np.int32)
        return mesh

    @cached_property
    def component_numbers(self) -> Ints32:
        """(c,) ascending numbers, in the whole mesh, of the components that the patch meets."""
        assert self.components is not None
        return np.unique(self.components)

    @property
    def own(self) -> Bools:
        """(j,) faces that belong to this patch: those whose first corner is inside."""
        return np.asarray(self.inside[self.corners[:, 0]])

    def check_complete(self, faces: Bools) -> None:
        """Raise TooNarrow unless all faces of the whole mesh around some faces, (j,) bool, are in the patch."""
        if not self.complete[self.corners[faces]].all():
            raise TooNarrow

    def narrowed(self, rings: int) -> tuple["MeshPatch", Ints]:
        """Return the patch with a halo of fewer edges, and the numbers that its faces have in this one."""
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

    @classmethod
    def whole(cls, mesh: Mesh) -> "MeshPatch":
        """Return a whole mesh as its only patch."""
        every = np.ones(len(mesh.vertices), bool)
        vertices, faces = np.arange(len(mesh.vertices), dtype=np.int32), np.arange(len(mesh.faces), dtype=np.int32)
        patch = cls(mesh.vertices, mesh.faces, 0, vertices, faces, every, every, {})
        patch.__dict__["mesh"] = mesh
        return patch


class Cutter:
    """Boxes that hold equally many vertices, from which patches grow.

    Parameters
    ----------
    points
        (n, 3) positions of the vertices.
    depth
        Number of times that the boxes are halved across their longest side; there are 2**depth of them.
    """

    def __init__(self, points: Vectors, depth: int) -> None:
        self.count = 1 << depth
        self._order = np.arange(len(points), dtype=np.int32)
        _halve(points, self._order, depth)
        self._starts = _starts(len(points), depth)
        self._place = np.full(len(points), -1, np.int32)

    def patch(
        self, mesh: Mesh, number: int, rings: int, facts: Mapping[str, float], components: Ints32 | None
    ) -> MeshPatch:
        """Return the patch of a box.

        Parameters
        ----------
        mesh
            Mesh with n vertices, which may be elsewhere than the points that the boxes were made from.
        number
            Number of the box, 0 … `count` - 1.
        rings
            Width of the halo in edges.
        facts, components
            As in `MeshPatch`, the components of all n vertices.
        """
        faces, around, place = mesh.faces, mesh.topology.vertex_faces, self._place
        seeds = self._order[self._starts[number] : self._starts[number + 1]]
        seeds = seeds[around.indptr[seeds + 1] > around.indptr[seeds]]  # a vertex without a face is in no patch
        near = _grown(faces, around, seeds, rings, place)
        near.sort()
        place[near] = np.arange(len(near), dtype=np.int32)
        numbers = _faces_between(faces, around, near, place)
        numbers.sort()
        corners, inside = place[faces[numbers]], np.zeros(len(near), bool)
        inside[place[seeds]] = True
        place[near] = -1
        complete = np.bincount(corners.ravel(), minlength=len(near)) == around.indptr[near + 1] - around.indptr[near]
        of_here = None if components is None else components[near]
        return MeshPatch(mesh.vertices[near], corners, number, near, numbers, inside, complete, facts, of_here)


def lighter(patch: MeshPatch) -> MeshPatch:
    """Return what tells where results of a patch belong, without its positions."""
    return replace(patch, vertices=patch.vertices[:0], complete=patch.complete[:0])


def _halve(points: Vectors, order: Ints32, depth: int) -> None:
    """Sort numbers of points so that each of the 2**depth parts of `order` lies in a box of its own."""
    if depth == 0:
        return
    mine = points[order]
    along = mine[:, int(np.argmax(np.ptp(mine, axis=0)))] if len(mine) else mine[:, 0]
    middle = len(order) // 2
    if len(order) > 1:
        order[:] = order[np.argpartition(along, middle)]
    del mine, along
    _halve(points, order[:middle], depth - 1)
    _halve(points, order[middle:], depth - 1)


def _starts(count: int, depth: int) -> Ints:
    """Return where each of the 2**depth parts that `_halve` makes begins, and the end, (2**depth + 1,)."""
    starts = [0, count]
    for _ in range(depth):
        middles = [first + (last - first) // 2 for first, last in pairwise(starts)]
        starts = [*(start for pair in zip(starts[:-1], middles, strict=True) for start in pair), count]
    return np.array(starts)


@kernel
def _grown(faces: Ints32, around: Csr, seeds: Ints32, rings: int, place: Ints32) -> Ints32:
    """Return the vertices within some rings of the seeds, and mark them by 0 in `place`, which holds -1 elsewhere."""
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
    """Return the faces all of whose corners have a place, which the given vertices are."""
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
