"""Mesh connectivity, independent of vertex positions."""

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.arrays import Bools, Floats, Ints32, marked, scatter_add
from cascadenorm.compute.csr import Csr, grouped, joined_rows
from cascadenorm.compute.kernels import kernel
from cascadenorm.compute.threads import parallel_for
from cascadenorm.mesh.topology_kernels import (
    across_range,
    color_vertices,
    edges_up_range,
    face_ring_range,
    fill_groups,
    fill_neighbors,
    pair_range,
    sides_up_range,
)


class Topology:
    """Adjacency of m triangles, (m, 3) int32, and n vertices; each relation is computed on first access.

    The mesh need not be manifold: an edge may have one, two or more faces. Neighbours are ordered by index only.
    """

    def __init__(self, faces: Ints32, vertex_count: int) -> None:
        self.faces = faces
        self.vertex_count = vertex_count
        self._face_rings: dict[int, Csr] = {}

    def forget(self) -> None:
        """Free all cached arrays; they are recomputed on the next access."""
        for name in self.__dict__.keys() - {"faces", "vertex_count", "_face_rings"}:
            self.__dict__.pop(name, None)  # another thread may have freed it
        self._face_rings.clear()

    def forget_adjacent_faces(self) -> None:
        """Free the relations between faces and of edges to faces, but not those of vertices."""
        for name in ("face_edges", "edge_faces", "interior_edges", "face_pairs", "faces_across"):
            self.__dict__.pop(name, None)
        self._face_rings.clear()

    @cached_property
    def vertex_faces(self) -> Csr:
        """Faces around each vertex, ascending; a face that repeats the vertex is listed twice."""
        return rows_with(self.faces, self.vertex_count)

    def face_rings(self, ring: int) -> Csr:
        """Return the faces within `ring` steps of each face, without the face itself.

        One step leads to all faces that share a vertex; where more than MOST_AROUND faces share one, to as many with
        the next lower and the next higher numbers.
        """
        if ring < 1:
            raise ValueError(f"ring is {ring}; it must be at least 1")
        found = self._face_rings.get(ring)
        if found is None:
            parts = parallel_for(len(self.faces), face_ring_range, self.faces, self.vertex_faces, ring)
            found = self._face_rings[ring] = joined_rows(len(self.faces), parts)
        return found

    @cached_property
    def edges(self) -> Ints32:
        """(e, 2) vertices of each undirected edge, lower index first, rows ascending."""
        parts = parallel_for(self.vertex_count, edges_up_range, self.faces, self.vertex_faces)
        up = joined_rows(self.vertex_count, parts)
        return np.stack([up.rows, up.indices], axis=1)

    @cached_property
    def face_edges(self) -> Ints32:
        """(m, 3) edge of each face side; side k joins corners k and (k + 1) % 3."""
        lower, higher = np.ascontiguousarray(self.edges.T)
        up = Csr(np.append(0, np.cumsum(np.bincount(lower, minlength=self.vertex_count))), higher)
        of_sides = np.empty(self.faces.shape, np.int32)
        parallel_for(self.vertex_count, sides_up_range, self.faces, self.vertex_faces, up, of_sides)
        of_sides.flags.writeable = False  # same type as `faces`, so that kernels are compiled once
        return of_sides

    @cached_property
    def edge_faces(self) -> Csr:
        """Faces at each edge, ascending: one at a boundary, two inside a manifold, more at a non-manifold edge."""
        return rows_with(self.face_edges, len(self.edges))

    @cached_property
    def interior_edges(self) -> Ints32:
        """Numbers of the edges with exactly two faces."""
        return np.flatnonzero(self.edge_faces.counts == 2).astype(np.int32)

    @cached_property
    def face_pairs(self) -> Ints32:
        """(i, 2) the two faces of each interior edge, lower index first."""
        out = np.empty((len(self.interior_edges), 2), np.int32)
        parallel_for(len(out), pair_range, self.interior_edges, self.edge_faces, out)
        return out

    @cached_property
    def faces_across(self) -> Ints32:
        """(m, 3) face across each side; -1 if there is none or more than one."""
        out = np.empty(self.face_edges.shape, np.int32)
        parallel_for(len(out), across_range, self.face_edges, self.edge_faces, out)
        return out

    @cached_property
    def balance(self) -> Floats:
        """(e,) number of faces that traverse each edge from its lower vertex, minus those in the other direction."""
        rising = np.sign(np.roll(self.faces, -1, axis=1) - self.faces)
        return scatter_add(self.face_edges.ravel(), rising.ravel(), len(self.edges))

    def fans(self, across: Bools | None = None) -> Ints32:
        """Return the (3m,) fan of each face corner: corners at a vertex share a fan if their faces connect there.

        Faces are connected across the edges that are true in `across`, (e,); None selects all edges.
        """
        # Sides in the order of their edges, with the corners at the lower and at the higher end of each
        sides = np.argsort(self.face_edges, axis=None, kind="stable")
        edges, start, ahead = self.face_edges.ravel()[sides], sides, sides - sides % 3 + (sides + 1) % 3
        falls = self.faces.ravel()[start] > self.faces.ravel()[ahead]
        lower, higher = np.where(falls, ahead, start), np.where(falls, start, ahead)

        joins = edges[1:] == edges[:-1]
        if across is not None:
            joins &= across[edges[1:]]
        links = [np.stack([corners[:-1], corners[1:]], axis=1)[joins] for corners in (lower, higher)]
        return connected_components(np.concatenate(links), self.faces.size)

    @cached_property
    def used_vertices(self) -> Bools:
        """(n,) whether each vertex is referenced by a face."""
        return marked(self.faces, self.vertex_count)

    @cached_property
    def boundary_vertices(self) -> Bools:
        """(n,) whether each vertex lies on an edge with a single face."""
        return marked(self.edges[self.edge_faces.counts == 1], self.vertex_count)

    @cached_property
    def vertex_neighbors(self) -> Csr:
        """Vertices adjacent to each vertex, ascending."""
        return rows_with(self.edges[self.edges[:, 0] != self.edges[:, 1]], self.vertex_count, fill_neighbors)

    @cached_property
    def vertex_colors(self) -> Csr:
        """Vertices with a face, grouped by a greedy colouring: no group holds two vertices of a face.

        Vertices of one group can be updated in any order if an update reads only the faces around its vertex.
        """
        colors = np.full(self.vertex_count, -1, np.int32)
        color_vertices(self.faces, self.vertex_faces, colors)
        return grouped(colors)

    @cached_property
    def components(self) -> Ints32:
        """(n,) connected component of each vertex; a vertex without a face is a component of its own."""
        return connected_components(self.edges, self.vertex_count)

    @property
    def component_count(self) -> int:
        """Number of connected components, including vertices without a face."""
        return int(self.components.max(initial=-1)) + 1

    @cached_property
    def face_components(self) -> Ints32:
        """(m,) connected component of each face, as in `components`."""
        return self.components[self.faces[:, 0]]


def rows_with(numbers: Ints32, count: int, fill: Callable[..., None] = fill_groups) -> Csr:
    """Return the rows of an array, (k, w), that contain each of 0 … count - 1, ascending and with repetitions.

    With `fill_neighbors`, return the other ends of the rows, which are pairs.
    """
    indptr = np.zeros(count + 2, np.int64)
    indptr[2:] = np.bincount(numbers.ravel(), minlength=count)
    np.cumsum(indptr, out=indptr)
    indices = np.empty(numbers.size, np.int32)
    fill(numbers, indptr[1:], indices)
    return Csr(indptr[:-1], indices)


def connected_components(links: NDArray[Any], count: int) -> Ints32:
    """Return the (count,) component of each node of a graph with (k, 2) links, numbered by their first nodes."""
    labels = np.arange(count, dtype=np.int32)
    _label(np.ascontiguousarray(links, np.int32), labels)
    return labels


@kernel
def _label(links: Ints32, labels: Ints32) -> None:
    """Find components by union-find: until they are numbered, each label is the node itself or a lower node."""
    for k in range(len(links)):
        one, other = _root_of(labels, links[k, 0]), _root_of(labels, links[k, 1])
        labels[max(one, other)] = min(one, other)
    count = 0
    for i in range(len(labels)):
        if labels[i] == i:
            labels[i] = count
            count += 1
        else:
            labels[i] = labels[labels[i]]


@kernel
def _root_of(labels: Ints32, node: np.int32) -> np.int32:
    """Return the root of a node's tree, halving the path to it."""
    while labels[node] != node:
        labels[node] = labels[labels[node]]
        node = labels[node]
    return node
