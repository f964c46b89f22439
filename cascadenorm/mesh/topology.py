"""Who touches whom: the part of a mesh that does not change when vertices move."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from cascadenorm.mesh.arrays import Ints, Ints32, doubled, scatter_add
from cascadenorm.mesh.kernels import kernel
from cascadenorm.mesh.threads import parallel_for


class Csr(NamedTuple):
    """Rows of unequal length: row i is indices[indptr[i] : indptr[i + 1]]."""

    indptr: NDArray[np.int64]
    indices: NDArray[np.int32]

    def row(self, i: int) -> NDArray[np.int32]:
        """Return the entries of row i."""
        return self.indices[self.indptr[i] : self.indptr[i + 1]]

    @property
    def counts(self) -> NDArray[np.int64]:
        """Length of each row."""
        return np.diff(self.indptr)

    @property
    def rows(self) -> NDArray[np.int32]:
        """Row number of each entry, so that (rows, indices) are the pairs."""
        return np.repeat(np.arange(len(self.indptr) - 1, dtype=np.int32), self.counts)


class Topology:
    """Neighbourhoods of m triangles over n vertices, each made when first asked for.

    Nothing here needs a manifold: an edge may have one, two or more faces, and neighbours carry no order beyond
    that of their numbers.

    Parameters
    ----------
    faces : (m, 3) int32, every entry in 0 … n - 1
    vertex_count : n
    """

    def __init__(self, faces: NDArray[np.int32], vertex_count: int) -> None:
        self.faces = faces
        self.vertex_count = vertex_count
        self._face_rings: dict[int, Csr] = {}

    @cached_property
    def vertex_faces(self) -> Csr:
        """Faces around each vertex, ascending; a face that repeats a vertex is listed twice."""
        indptr = np.zeros(self.vertex_count + 1, np.int64)
        np.cumsum(np.bincount(self.faces.ravel(), minlength=self.vertex_count), out=indptr[1:])
        indices = np.empty(self.faces.size, np.int32)
        _fill_vertex_faces(self.faces, indptr[:-1].copy(), indices)
        return Csr(indptr, indices)

    def face_rings(self, ring: int) -> Csr:
        """Faces within `ring` steps of each face, itself left out; a step leads to a face that shares a vertex."""
        if ring < 1:
            raise ValueError(f"ring is {ring}; it must be at least 1")
        if ring not in self._face_rings:
            parts = parallel_for(len(self.faces), _face_ring_range, self.faces, self.vertex_faces, ring)
            self._face_rings[ring] = _joined(len(self.faces), parts)
        return self._face_rings[ring]

    @cached_property
    def _edges(self) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """Unique undirected edges, and the edge of each face side; side k joins corners k and k + 1."""
        parts = parallel_for(self.vertex_count, _edges_up_range, self.faces, self.vertex_faces)
        up = _joined(self.vertex_count, parts)
        of_sides = np.empty(self.faces.shape, np.int32)
        parallel_for(self.vertex_count, _sides_up_range, self.faces, self.vertex_faces, up, of_sides)
        return np.stack([up.rows, up.indices], axis=1), of_sides

    @property
    def edges(self) -> NDArray[np.int32]:
        """(e, 2) vertices of each undirected edge, smaller first, rows ascending."""
        return self._edges[0]

    @property
    def face_edges(self) -> NDArray[np.int32]:
        """(m, 3) edge of each face side; side k joins corners k and (k + 1) % 3."""
        return self._edges[1]

    @cached_property
    def edge_faces(self) -> Csr:
        """Faces at each edge, ascending: one at a boundary, two inside a manifold, more at a non-manifold edge."""
        order = np.argsort(self.face_edges, axis=None, kind="stable")
        indptr = np.zeros(len(self.edges) + 1, np.int64)
        np.cumsum(np.bincount(self.face_edges.ravel(), minlength=len(self.edges)), out=indptr[1:])
        return Csr(indptr, (order // 3).astype(np.int32))

    @cached_property
    def interior_edges(self) -> NDArray[np.int32]:
        """Numbers of the edges that have exactly two faces."""
        return np.flatnonzero(self.edge_faces.counts == 2).astype(np.int32)

    @cached_property
    def face_pairs(self) -> NDArray[np.int32]:
        """(i, 2) the two faces of each interior edge, the smaller number first."""
        return np.asarray(self.edge_faces.indices[self.edge_faces.indptr[self.interior_edges, None] + np.arange(2)])

    @cached_property
    def faces_across(self) -> NDArray[np.int32]:
        """(m, 3) the face on the other side of each face side, -1 where there is none or there are several."""
        total = np.full(len(self.edges), -1, np.int64)
        total[self.interior_edges] = self.face_pairs.sum(axis=1, dtype=np.int64)
        around = total[self.face_edges]
        return np.where(around >= 0, around - np.arange(len(self.faces))[:, None], -1).astype(np.int32)

    @cached_property
    def balance(self) -> NDArray[np.float64]:
        """(e,) faces that run along each edge from its smaller vertex, less those that run from the larger one."""
        rising = np.sign(np.roll(self.faces, -1, axis=1) - self.faces)
        return scatter_add(self.face_edges.ravel(), rising.ravel(), len(self.edges))

    def fans(self, across: NDArray[np.bool_] | None = None) -> NDArray[np.int32]:
        """(3m,) fan of each corner of the faces: those at a vertex whose faces are connected there have one number.

        Parameters
        ----------
        across : (e,) the edges across which faces are connected; None: all
        """
        order = np.argsort(self.face_edges, axis=None, kind="stable")
        of_edge = self.face_edges.ravel()[order]
        joined = of_edge[1:] == of_edge[:-1]
        pairs = np.flatnonzero(joined if across is None else joined & across[of_edge[1:]])
        corners = np.arange(self.faces.size).reshape(-1, 3)
        ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)  # of each side
        falling = self.faces.ravel()[ends[:, 0]] > self.faces.ravel()[ends[:, 1]]
        ends[falling] = ends[falling, ::-1]  # the corner of the smaller vertex first
        one, other = ends[order[pairs]].ravel(), ends[order[pairs + 1]].ravel()
        graph = sparse.coo_array((np.ones(len(one), np.int8), (one, other)), (self.faces.size, self.faces.size))
        return np.asarray(sparse.csgraph.connected_components(graph, directed=False)[1], np.int32)

    @cached_property
    def used_vertices(self) -> NDArray[np.bool_]:
        """(n,) whether a face references a vertex."""
        mask = np.zeros(self.vertex_count, bool)
        mask[self.faces] = True
        return mask

    @cached_property
    def boundary_vertices(self) -> NDArray[np.bool_]:
        """(n,) whether a vertex lies on an edge with a single face."""
        mask = np.zeros(self.vertex_count, bool)
        mask[self.edges[self.edge_faces.counts == 1]] = True
        return mask

    @cached_property
    def vertex_neighbors(self) -> Csr:
        """Vertices joined to each vertex by an edge, ascending."""
        proper = self.edges[self.edges[:, 0] != self.edges[:, 1]]
        ends = np.concatenate([proper, proper[:, ::-1]])
        matrix = sparse.csr_matrix(
            (np.ones(len(ends), np.int8), (ends[:, 0], ends[:, 1])), (self.vertex_count, self.vertex_count)
        )
        matrix.sort_indices()
        return Csr(matrix.indptr.astype(np.int64), matrix.indices.astype(np.int32))

    @cached_property
    def vertex_colors(self) -> Csr:
        """Vertices with a face, in groups none of which holds two of one face; each takes the first group it can.

        So what moves the vertices of a group, and reads their faces alone, may do so in any order.
        """
        colors = np.full(self.vertex_count, -1, np.int32)
        _color_vertices(self.faces, self.vertex_faces, colors)
        order = np.argsort(colors, kind="stable").astype(np.int32)
        counts = np.bincount(colors + 1)
        return Csr(np.cumsum(counts) - counts[0], order[counts[0] :])

    @cached_property
    def components(self) -> NDArray[np.int32]:
        """(n,) number of the connected component of each vertex; a vertex without a face is one of its own."""
        neighbors = self.vertex_neighbors
        graph = sparse.csr_matrix(
            (np.ones(len(neighbors.indices), np.int8), neighbors.indices, neighbors.indptr),
            (self.vertex_count, self.vertex_count),
        )
        return np.asarray(sparse.csgraph.connected_components(graph, directed=False)[1], np.int32)

    @cached_property
    def face_components(self) -> NDArray[np.int32]:
        """(m,) number of the connected component of each face, as in `components`."""
        return self.components[self.faces[:, 0]]


def _joined(count: int, parts: list[tuple[NDArray[np.int64], NDArray[np.int32]]]) -> Csr:
    """Put rows together that were made range by range: the counts of each, and their entries row after row."""
    indptr = np.zeros(count + 1, np.int64)
    if parts:
        np.cumsum(np.concatenate([counts for counts, _ in parts]), out=indptr[1:])
    return Csr(indptr, np.concatenate([found for _, found in parts]) if parts else np.empty(0, np.int32))


@kernel
def _fill_vertex_faces(faces: Ints32, free: Ints, indices: Ints32) -> None:
    for f in range(len(faces)):
        for corner in range(3):
            v = faces[f, corner]
            indices[free[v]] = f
            free[v] += 1


@kernel
def _edges_up_range(start: int, stop: int, faces: Ints32, around: Csr) -> tuple[Ints, Ints32]:
    """Other ends of the edges at each vertex in start … stop that is their smaller one, ascending."""
    counts = np.empty(stop - start, np.int64)
    found = np.empty(
        2 * (around.indptr[stop] - around.indptr[start]) + 1, np.int32
    )  # two sides of each face at a vertex
    end = 0
    for i in range(start, stop):
        first = end
        for k in range(around.indptr[i], around.indptr[i + 1]):
            f = around.indices[k]
            if k > around.indptr[i] and around.indices[k - 1] == f:
                continue  # a face that repeats the vertex
            for side in range(3):
                a, b = faces[f, side], faces[f, (side + 1) % 3]
                if min(a, b) == i:
                    found[end] = max(a, b)
                    end += 1
        # each inner edge was found twice, from either face: keep one
        _sort(found[first:end])
        last, end = end, first
        for k in range(first, last):
            if end == first or found[end - 1] != found[k]:
                found[end] = found[k]
                end += 1
        counts[i - start] = end - first
    return counts, found[:end].copy()


@kernel
def _sides_up_range(
    start: int,
    stop: int,
    faces: Ints32,
    around: Csr,
    up: Csr,
    of_sides: Ints32,
) -> None:
    """Number of the edge of each face side whose smaller vertex is in start … stop."""
    for i in range(start, stop):
        for k in range(around.indptr[i], around.indptr[i + 1]):
            f = around.indices[k]
            for side in range(3):
                a, b = faces[f, side], faces[f, (side + 1) % 3]
                if min(a, b) == i:
                    # halve the row, whose entries ascend, until one is left
                    low, high = up.indptr[i], up.indptr[i + 1] - 1
                    while low < high:
                        middle = (low + high) // 2
                        if up.indices[middle] < max(a, b):
                            low = middle + 1
                        else:
                            high = middle
                    of_sides[f, side] = low


@kernel
def _sort(values: Ints32) -> None:
    """Sort values in place (Shell 1959); numpy's sort takes a second to compile."""
    gap = 1
    while gap < len(values) // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for k in range(gap, len(values)):
            value, place = values[k], k
            while place >= gap and values[place - gap] > value:
                values[place] = values[place - gap]
                place -= gap
            values[place] = value
        gap //= 3


@kernel
def _color_vertices(faces: Ints32, around: Csr, colors: Ints32) -> None:
    taken = np.full(len(colors) + 1, -1, np.int32)  # by which vertex a colour was last seen in a neighbour
    for i in range(len(colors)):
        first, last = around.indptr[i], around.indptr[i + 1]
        for k in range(first, last):
            for corner in range(3):
                color = colors[faces[around.indices[k], corner]]
                if color >= 0:
                    taken[color] = i
        color = 0
        while taken[color] == i:
            color += 1
        if last > first:
            colors[i] = color


@kernel
def _face_ring_range(start: int, stop: int, faces: Ints32, around: Csr, ring: int) -> tuple[Ints, Ints32]:
    """Search breadth first from each face in start … stop; the counts, and the faces found, row after row."""
    seen = np.full(len(faces), -1, np.int32)
    counts = np.empty(stop - start, np.int64)
    found = np.empty(max(64, 16 * ring * ring * (stop - start)), np.int32)
    end = 0
    for f in range(start, stop):
        first = end
        seen[f] = f
        level_start, level_stop = first, first
        for step in range(ring):
            # the faces of the last ring, or the face itself, lead to the next ring over their vertices
            level_size = 1 if step == 0 else level_stop - level_start
            for i in range(level_size):
                center = f if step == 0 else found[level_start + i]
                for corner in range(3):
                    v = faces[center, corner]
                    for k in range(around.indptr[v], around.indptr[v + 1]):
                        g = around.indices[k]
                        if seen[g] == f:
                            continue
                        seen[g] = f
                        if end == len(found):
                            found = doubled(found)
                        found[end] = g
                        end += 1
            level_start, level_stop = level_stop, end
        counts[f - start] = end - first
    return counts, found[:end].copy()
