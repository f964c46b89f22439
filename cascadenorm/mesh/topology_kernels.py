"""Kernels that compute the topology of a mesh."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.arrays import Index, Ints, Ints32, doubled
from cascadenorm.compute.csr import Csr
from cascadenorm.compute.kernels import kernel

# It bounds neighbourhoods where many faces meet at a vertex or edge. If fewer faces meet, all of them are neighbours.
MOST_AROUND = 128  # faces before and after a face, in the list around a vertex, that are its neighbours there


@kernel
def fill_groups(numbers: Ints32, free: Ints, indices: Ints32) -> None:
    """Store each row index at the next free place of every number in the row."""
    for row in range(len(numbers)):
        for column in range(numbers.shape[1]):
            number = numbers[row, column]
            indices[free[number]] = row
            free[number] += 1


@kernel
def fill_neighbors(edges: Ints32, free: Ints, indices: Ints32) -> None:
    """Store each end of an edge as a neighbour of the other end; lower ends come before higher ones."""
    for here in (1, 0):
        for e in range(len(edges)):
            vertex = edges[e, here]
            indices[free[vertex]] = edges[e, 1 - here]
            free[vertex] += 1


@kernel
def edges_up_range(start: int, stop: int, faces: Ints32, around: Csr) -> tuple[Ints, Ints32]:
    """Find the higher ends, ascending, of the edges whose lower end is a vertex in start … stop."""
    counts = np.empty(stop - start, np.int64)
    found = np.empty(
        2 * (around.indptr[stop] - around.indptr[start]) + 1, np.int32
    )  # two sides of each face at the vertex
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
        # interior edges were found once from each face: keep one copy
        sort(found[first:end])
        last, end = end, first
        for k in range(first, last):
            if end == first or found[end - 1] != found[k]:
                found[end] = found[k]
                end += 1
        counts[i - start] = end - first
    return counts, found[:end]


@kernel
def _place_of(indices: Ints32, low: int, high: int, number: Index) -> int:
    """Return the place of a number in the ascending indices from low to high, by binary search."""
    while low < high:
        middle = (low + high) // 2
        if indices[middle] < number:
            low = middle + 1
        else:
            high = middle
    return low


@kernel
def sides_up_range(start: int, stop: int, faces: Ints32, around: Csr, up: Csr, of_sides: Ints32) -> None:
    """Write the edge number of each face side whose lower vertex is in start … stop."""
    for i in range(start, stop):
        for k in range(around.indptr[i], around.indptr[i + 1]):
            f = around.indices[k]
            for side in range(3):
                a, b = faces[f, side], faces[f, (side + 1) % 3]
                if min(a, b) == i:
                    higher = np.int64(max(a, b))  # same type as in `_near`: kernels are compiled for each type
                    of_sides[f, side] = _place_of(up.indices, up.indptr[i], up.indptr[i + 1] - 1, higher)


@kernel
def pair_range(start: int, stop: int, edges: Ints32, around: Csr, out: Ints32) -> None:
    """Write the two faces of each given edge."""
    for i in range(start, stop):
        first = around.indptr[edges[i]]
        out[i, 0], out[i, 1] = around.indices[first], around.indices[first + 1]


@kernel
def across_range(start: int, stop: int, face_edges: Ints32, around: Csr, out: Ints32) -> None:
    """Write the face across each side; -1 unless its edge has exactly two faces."""
    for f in range(start, stop):
        for side in range(3):
            edge = face_edges[f, side]
            first = around.indptr[edge]
            out[f, side] = -1
            if around.indptr[edge + 1] - first == 2:
                one, other = around.indices[first], around.indices[first + 1]
                out[f, side] = other if one == f else one


@kernel
def sort(values: NDArray[Any]) -> None:
    """Sort values in place (Shell 1959); it compiles faster than numpy's sort."""
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
def color_vertices(faces: Ints32, around: Csr, colors: Ints32) -> None:
    """Give each vertex with a face, in order, the lowest colour that its neighbours do not have; -1 means no colour."""
    taken = np.full(len(colors) + 1, -1, np.int32)  # last vertex with a neighbour of each colour
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
def _near(around: Csr, vertex: int, face: int) -> tuple[int, int]:
    """Return start and stop of the neighbours of a face in the ascending list of faces around one of its vertices."""
    first, last = around.indptr[vertex], around.indptr[vertex + 1]
    if last - first <= MOST_AROUND + 1:
        return first, last
    low = _place_of(around.indices, first, last - 1, face)
    return max(first, low - MOST_AROUND), min(last, low + MOST_AROUND + 1)


@kernel
def face_ring_range(start: int, stop: int, faces: Ints32, around: Csr, ring: int) -> tuple[Ints, Ints32]:
    """Search breadth first from each face in start … stop; return the row lengths and the faces found."""
    seen = np.full(len(faces), -1, np.int32)
    counts = np.empty(stop - start, np.int64)
    found = np.empty(max(64, 16 * ring * ring * (stop - start)), np.int32)
    end = 0
    for f in range(start, stop):
        first = end
        seen[f] = f
        level_start, level_stop = first, first
        for step in range(ring):
            # the faces around the vertices of the last ring, or of the face itself, form the next ring
            level_size = 1 if step == 0 else level_stop - level_start
            for i in range(level_size):
                center = f if step == 0 else found[level_start + i]
                for corner in range(3):
                    near, end_of_near = _near(around, faces[center, corner], center)
                    while end + end_of_near - near > len(found):
                        found = doubled(found)
                    for k in range(near, end_of_near):
                        found[end] = around.indices[k]
                        end += seen[found[end]] != f  # without a branch, which the processor could not predict
                        seen[around.indices[k]] = f
            level_start, level_stop = level_stop, end
        counts[f - start] = end - first
    return counts, found[:end]
