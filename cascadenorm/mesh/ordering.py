"""Vertices and faces in an order in which neighbours on the surface are near in memory.

Every pass over a mesh gathers what the neighbours have. Where these lie all over memory, as in a mesh whose vertices or
faces were shuffled, waiting for memory takes several times as long as the arithmetic.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.arrays import Floats, Ints, Ints32, Vectors
from cascadenorm.compute.csr import Csr
from cascadenorm.compute.kernels import kernel
from cascadenorm.compute.threads import parallel_for
from cascadenorm.mesh.mesh import Mesh
from cascadenorm.mesh.topology import rows_with
from cascadenorm.mesh.topology_kernels import sort

CACHE_LINE = 8  # vertices a cache line holds a part of
LINES = 512
POOR = 20.0
"""Cache misses, against the fewest possible, from which a mesh is renumbered: shuffled ones have 30 to 48, those of
scanners and marching cubes 1 to 17, and 1 once they are renumbered."""
OUTLIER_VERTICES = 0.001  # share of the vertices at either end that do not count for the size of the cells
BITS = 21  # of each coordinate in a Morton code
SPREADS = tuple(
    (np.uint64(shift), np.uint64(mask))
    for shift, mask in (
        (32, 0x001F00000000FFFF),
        (16, 0x001F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    )
)
"""Steps that put two zeros between the bits of a coordinate: shifts, and the bits that stay."""
LOWER = (1 << 32) - 1


class Renumbered(NamedTuple):
    """A mesh with its vertices and faces in another order.

    Parameters
    ----------
    mesh
        n vertices.
    numbers
        (n,) the vertex of the given mesh that each of them is.
    places
        (n,) where each vertex of the given mesh is.
    """

    mesh: Mesh
    numbers: Ints
    places: Ints32

    @classmethod
    def unchanged(cls, mesh: Mesh) -> "Renumbered":
        """Return a mesh in the order that it has."""
        own = np.arange(len(mesh.vertices))
        return cls(mesh, own, own.astype(np.int32))


def ordered_for_cache(mesh: Mesh) -> Renumbered:
    """Return a mesh as it is where its order is good, else with vertices along a curve and faces beside them.

    Vertices are sorted by the Morton code of their position, and where two have one by position; faces begin with their
    first vertex and are sorted by it. So two poor orders of one mesh, of which no two vertices coincide, give the same
    mesh.
    """
    count = len(mesh.vertices)
    if cache_misses(mesh) <= POOR:
        return Renumbered.unchanged(mesh)
    numbers = _sorted(morton_codes(mesh.vertices), mesh.vertices)
    places = np.empty(count, np.int32)
    places[numbers] = np.arange(count)
    faces = _sorted_faces(renumbered_faces(mesh.faces, places), count)
    return Renumbered(Mesh(mesh.vertices[numbers], faces), numbers, places)


def renumbered_faces(faces: NDArray[Any], places: NDArray[Any]) -> NDArray[Any]:
    """Return faces, (m, 3), by the places of their vertices, (n,), each with its corners from the least place on."""
    out = np.empty(faces.shape, places.dtype)
    parallel_for(len(faces), _renumber_range, faces, places, out)
    return out


def _sorted_faces(faces: Ints32, count: int) -> Ints32:
    """Sort faces by their corners, the first of which are vertices from 0 to count; in half of the time of numpy."""
    out = np.empty_like(faces)
    parallel_for(count, _sort_range, faces, rows_with(faces[:, :1].copy(), count), out)
    return out


def _sorted(codes: NDArray[np.uint64], points: Vectors) -> Ints:
    """Return indices that sort by codes, and where two are the same by position."""
    order = np.argsort(codes)
    repeated = (codes[order[1:]] == codes[order[:-1]]).any()  # else one sort will do, which takes a fifth of the time
    return np.asarray(np.lexsort((*points.T, codes)) if repeated else order)


def cache_misses(mesh: Mesh) -> float:
    """Count how often a cache lacks a vertex as face after face asks for its own, against the fewest possible.

    The cache has lines of memory with vertices and is direct-mapped: of those that have one number modulo LINES it
    holds the last one used.
    """
    return _ask(mesh.faces, np.full(LINES, -1, np.int64)) * CACHE_LINE / len(mesh.vertices)


@kernel
def _ask(faces: Ints32, held: Ints) -> int:
    """Count the vertices whose line is not held when a face asks for it; from then on it is."""
    missed = 0
    for f in range(len(faces)):
        for corner in range(3):
            line = faces[f, corner] // CACHE_LINE
            if held[line % LINES] != line:
                held[line % LINES] = line
                missed += 1
    return missed


def morton_codes(points: Vectors) -> NDArray[np.uint64]:
    """Number the cells of a grid over points, (n, 3), along a curve that fills space; points far out go to its border.

    The bits of the three coordinates take turns.
    """
    lower, upper = np.quantile(points, [OUTLIER_VERTICES, 1 - OUTLIER_VERTICES], axis=0)
    size = max(float((upper - lower).max()), np.finfo(float).tiny)
    codes = np.empty(len(points), np.uint64)
    parallel_for(len(points), _code_range, points, lower, size, codes)
    return codes


@kernel
def _code_range(start: int, stop: int, points: Vectors, lower: Floats, size: float, codes: NDArray[np.uint64]) -> None:
    """Write the Morton codes of points."""
    for i in range(start, stop):
        code = np.uint64(0)
        for axis in range(3):
            share = min(max((points[i, axis] - lower[axis]) / size, 0.0), 1.0)
            code |= _spread(np.uint64(share * (2**BITS - 1))) << np.uint64(axis)
        codes[i] = code


@kernel
def _spread(number: np.uint64) -> np.uint64:
    """Put two zeros above each of the BITS lowest bits."""
    for shift, mask in SPREADS:
        number = (number | (number << shift)) & mask
    return number


@kernel
def _renumber_range(start: int, stop: int, faces: NDArray[Any], places: NDArray[Any], out: NDArray[Any]) -> None:
    for f in range(start, stop):
        a, b, c = places[faces[f, 0]], places[faces[f, 1]], places[faces[f, 2]]
        if b < a and b <= c:
            a, b, c = b, c, a
        elif c < a and c < b:
            a, b, c = c, a, b
        out[f, 0], out[f, 1], out[f, 2] = a, b, c


@kernel
def _sort_range(start: int, stop: int, faces: Ints32, beginning: Csr, out: Ints32) -> None:
    """Write the faces that begin with each vertex in start … stop, ascending."""
    begin = beginning.indptr[start]
    others = np.empty(beginning.indptr[stop] - begin, np.int64)
    for k in range(len(others)):
        f = beginning.indices[begin + k]
        others[k] = (np.int64(faces[f, 1]) << 32) + faces[f, 2]
    for i in range(start, stop):
        first, last = beginning.indptr[i], beginning.indptr[i + 1]
        sort(others[first - begin : last - begin])
        for k in range(first, last):
            other = others[k - begin]
            out[k, 0], out[k, 1], out[k, 2] = i, other >> 32, other & LOWER
