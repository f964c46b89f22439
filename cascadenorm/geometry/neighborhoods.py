"""Neighbourhoods within a radius, found by graph search."""

from typing import NamedTuple

import numpy as np

from cascadenorm.mesh import (
    SMALLEST_COSTLY_CHUNK,
    Bools,
    Csr,
    Floats,
    Index,
    Ints,
    Ints32,
    Mesh,
    Topology,
    Vectors,
    doubled,
    joined_rows,
    kernel,
    parallel_for,
)
from cascadenorm.mesh.vectors import row, squared_distance

UNLIMITED = 2**31 - 1
LEAST_SEARCHES = 16  # smallest number of centres for a thread: a few large neighbourhoods are worth several threads


def within(centers: Vectors, radii: Floats, points: Vectors, graph: Csr, seeds: Csr) -> Csr:
    """Find the points, (p, 3), within a radius of each centre that are connected to its seeds through such points.

    There are (k, 3) centres and (k,) radii. The graph has the neighbours of each point, and the seeds, k rows, are the
    points where the search of each centre starts; those outside the radius are skipped. Returns k rows of points
    in breadth-first order.
    """
    count = len(centers)
    parts = parallel_for(count, _within_range, centers, radii, points, graph, seeds, smallest=LEAST_SEARCHES)
    return joined_rows(count, parts)


def faces_near(mesh: Mesh, faces: Ints32, radius: float, *, most: int = UNLIMITED) -> Csr:
    """Find the faces with a centroid within a radius of that of each given face, connected to it through such faces.

    The result is that of `within` on the graph of faces that share a vertex, which need not be stored: a row for each
    of the (k,) given faces, in breadth-first order, with at most `most` faces, the first of which is the given one.
    """
    given = faces, mesh.faces, mesh.topology.vertex_faces, mesh.centroids, radius * radius, min(most, len(mesh.faces))
    parts = parallel_for(len(faces), _faces_near_range, *given, smallest=SMALLEST_COSTLY_CHUNK)
    return joined_rows(len(faces), parts)


def each_alone(count: int) -> Csr:
    """Return seeds that start the search of each point at the point itself."""
    return Csr(np.arange(count + 1, dtype=np.int64), np.arange(count, dtype=np.int32))


def steps_from(topology: Topology, seeds: Bools, most: int) -> Ints32:
    """Return the (n,) number of edges from each vertex to the nearest seed of (n,) bool, capped at `most` + 1."""
    steps = np.where(seeds, 0, most + 1).astype(np.int32)
    _steps(topology.faces, topology.vertex_faces, np.flatnonzero(seeds).astype(np.int32), most, steps)
    return steps


@kernel
def _steps(faces: Ints32, around: Csr, seeds: Ints32, most: int, steps: Ints32) -> None:
    """Search breadth first; the queue holds vertices by increasing number of steps."""
    queue = np.empty(len(steps), np.int32)
    queue[: len(seeds)] = seeds
    end = len(seeds)
    for i in range(len(steps)):
        if i == end or steps[queue[i]] == most:
            break
        vertex = queue[i]
        for k in range(around.indptr[vertex], around.indptr[vertex + 1]):
            for corner in range(3):
                other = faces[around.indices[k], corner]
                if steps[other] > steps[vertex] + 1:
                    steps[other] = steps[vertex] + 1
                    queue[end] = other
                    end += 1


@kernel
def _within_range(
    start: int, stop: int, centers: Vectors, radii: Floats, points: Vectors, neighbors: Csr, seeds: Csr
) -> tuple[Ints, Ints32]:
    """Search breadth first from the seeds of each centre in start … stop; return the row lengths and the points."""
    seen = np.full(len(points), -1, np.int32)
    counts = np.empty(stop - start, np.int64)
    found = np.empty(max(64, 24 * (stop - start)), np.int32)
    end = 0
    for i in range(start, stop):
        first = end
        limit = radii[i] * radii[i]
        # `found` also serves as the queue: it starts at `first`, and points before `current` have been visited
        current = first - 1  # stands for the seeds
        while current < end:
            if current < first:
                low, high, source = seeds.indptr[i], seeds.indptr[i + 1], seeds.indices
            else:
                j = found[current]
                low, high, source = neighbors.indptr[j], neighbors.indptr[j + 1], neighbors.indices
            for k in range(low, high):
                j = source[k]
                if seen[j] == i:
                    continue
                seen[j] = i
                if squared_distance(row(points, j), row(centers, i)) > limit:
                    continue
                if end == len(found):
                    found = doubled(found)
                found[end] = j
                end += 1
            current += 1
        counts[i - start] = end - first
    return counts, found[:end].copy()


@kernel
def search_faces(
    f: Index,
    faces: Ints32,
    around: Csr,
    centroids: Vectors,
    limit: float,
    seen: tuple[Ints32, Ints32],
    found: Ints32,
    distances: Floats,
) -> int:
    """Search breadth first from face f over faces that share a vertex; return the number of faces found.

    The faces and the squared distances of their centroids from that of f, at most `limit`, are written to `found` and
    `distances`. The search stops when these are full. `seen` is the last face whose search has met each face, (m,), and
    each vertex, (n,); initially -1.
    """
    of_faces, of_vertices = seen
    found[0], distances[0], of_faces[f] = f, 0.0, f
    current, end = 0, 1
    while current < end:
        for corner in range(3):
            v = faces[found[current], corner]
            if of_vertices[v] == f:  # the search has met all faces around it
                continue
            of_vertices[v] = f
            for k in range(around.indptr[v], around.indptr[v + 1]):
                g = around.indices[k]
                if of_faces[g] == f:
                    continue
                of_faces[g] = f
                squared = squared_distance(row(centroids, g), row(centroids, f))
                if squared > limit:
                    continue
                if end == len(found):
                    return end
                found[end], distances[end] = g, squared
                end += 1
        current += 1
    return end


class GroupSearch(NamedTuple):
    """Working arrays of `search_group` for m faces and n vertices, and its result: at most s faces."""

    met_faces: Ints32  # (m,) first member of the last group whose search has met each face; initially -1
    met_vertices: Ints32  # (n,) the same for each vertex
    places: Ints32  # (m,) place of each face that this search has met in the result, or -1 if it is too far away
    passed: Ints32  # (n,) members, as bits, for which the search has gone on from each vertex
    found: Ints32  # (s,) faces
    squared: Floats  # (s,) squared distances of their centroids from that of the first member
    near: Ints32  # (s,) members, as bits, within the radius of each face
    reached: Ints32  # (s,) members, as bits, whose neighbourhood contains each face
    queue: Ints32  # (s,) places that the search goes on from, in a ring
    queued: Bools  # (s,) whether each place is among them


@kernel
def group_search(faces: int, vertices: int, most: int) -> GroupSearch:
    """Allocate the arrays of a search over so many faces and vertices, with at most `most` faces as its result."""
    return GroupSearch(
        np.full(faces, -1, np.int32), np.full(vertices, -1, np.int32), np.empty(faces, np.int32),
        np.empty(vertices, np.int32), np.empty(most, np.int32), np.empty(most), np.empty(most, np.int32),
        np.empty(most, np.int32), np.empty(most, np.int32), np.zeros(most, np.bool_),
    )  # fmt: skip


@kernel
def search_group(
    members: Ints32, extent: float, faces: Ints32, around: Csr, centroids: Vectors, radius: float, search: GroupSearch
) -> int:
    """Search around several faces at once; return the number of faces found, or -1 if there is no space for them.

    The neighbourhood of a member contains the faces with a centroid within the radius of its own that are connected to
    it through such faces. All members share a vertex with the first one and are within the radius of it, at most
    `extent` away, so that a single breadth-first search finds the neighbourhoods of all (Then et al., The More the
    Merrier: Efficient Multi-Source Graph Traversal, 2014).
    """
    first, every = members[0], (1 << len(members)) - 1
    center, limit = row(centroids, first), radius * radius
    all_near, none_near = max(0.999999 * radius - extent, 0.0) ** 2, (1.000001 * radius + extent) ** 2
    search.met_faces[first], search.places[first] = first, 0
    search.found[0], search.squared[0], search.near[0], search.reached[0] = first, 0.0, every, every
    search.queue[0], search.queued[0] = 0, True
    total, head, waiting, most = 1, 0, 1, len(search.found)
    while waiting > 0:
        place = search.queue[head]
        head = head + 1 if head + 1 < most else 0
        waiting -= 1
        search.queued[place] = False
        for corner in range(3):
            v = faces[search.found[place], corner]
            if search.met_vertices[v] != first:
                search.met_vertices[v], search.passed[v] = first, 0
            new = search.reached[place] & ~search.passed[v]
            if new == 0:  # the search has met all faces around the vertex for these members
                continue
            search.passed[v] |= new
            for k in range(around.indptr[v], around.indptr[v + 1]):
                g = around.indices[k]
                if search.met_faces[g] != first:
                    search.met_faces[g], search.places[g] = first, -1
                    squared = squared_distance(row(centroids, g), center)
                    if squared > none_near:
                        continue
                    near = every
                    if squared > all_near:
                        near = 0
                        for member in range(len(members)):
                            apart = squared_distance(row(centroids, g), row(centroids, members[member]))
                            near |= (apart <= limit) << member
                    if near == 0:
                        continue
                    if total == most:
                        return -1
                    search.places[g], search.found[total], search.squared[total] = total, g, squared
                    search.near[total], search.reached[total], search.queued[total] = near, 0, False
                    total += 1
                other = search.places[g]
                if other < 0:
                    continue
                added = new & search.near[other] & ~search.reached[other]
                if added:
                    search.reached[other] |= added
                    if not search.queued[other]:
                        search.queued[other] = True
                        end = head + waiting
                        search.queue[end if end < most else end - most] = other
                        waiting += 1
    return total


@kernel
def _faces_near_range(
    start: int, stop: int, rows: Ints32, faces: Ints32, around: Csr, centroids: Vectors, limit: float, most: int
) -> tuple[Ints, Ints32]:
    """Search from the faces rows[start : stop]; return the row lengths and the faces found."""
    seen = np.full(len(faces), -1, np.int32), np.full(len(around.indptr) - 1, -1, np.int32)
    found, distances = np.empty(most, np.int32), np.empty(most)
    counts = np.empty(stop - start, np.int64)
    every = np.empty(max(64, 24 * (stop - start)), np.int32)
    end = 0
    for i in range(start, stop):
        count = search_faces(rows[i], faces, around, centroids, limit, seen, found, distances)
        while end + count > len(every):
            every = doubled(every)
        for k in range(count):
            every[end + k] = found[k]
        end += count
        counts[i - start] = count
    return counts, every[:end].copy()
