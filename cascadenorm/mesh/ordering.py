"""Vertices and faces in an order in which neighbours on the surface are near in memory.

Every pass over a mesh gathers what the neighbours have. Where these lie all over memory, as in a mesh whose vertices or
faces were shuffled, waiting for memory takes several times as long as the arithmetic.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh.arrays import Ints, Ints32, Vectors
from cascadenorm.mesh.kernels import kernel
from cascadenorm.mesh.mesh import Mesh

LINE = 8  # vertices a cache line holds a part of
LINES = 512
POOR = 20.0
"""Cache misses, against the fewest possible, from which a mesh is renumbered: shuffled ones have 30 to 48, those of
scanners and marching cubes 1 to 17, and 1 once they are renumbered."""
OUTLIERS = 0.001  # share of the vertices at either end that do not count for the size of the cells
BITS = 21  # of each coordinate in a Morton code


class Renumbered(NamedTuple):
    """A mesh with its vertices and faces in another order.

    Parameters
    ----------
    mesh : n vertices
    numbers : (n,) the vertex of the given mesh that each of them is
    places : (n,) where each vertex of the given mesh is
    """

    mesh: Mesh
    numbers: Ints
    places: Ints


def ordered_for_cache(mesh: Mesh) -> Renumbered:
    """Return a mesh as it is where its order is good, else with vertices along a curve and faces beside them.

    Vertices are sorted by the Morton code of their position, and where two have one by position; faces begin with their
    first vertex and are sorted by it. So two poor orders of one mesh, of which no two vertices coincide, give the same
    mesh.
    """
    count = len(mesh.vertices)
    if cache_misses(mesh) <= POOR:
        return Renumbered(mesh, np.arange(count), np.arange(count))
    numbers = _sorted(morton_codes(mesh.vertices), *mesh.vertices.T)
    places = np.empty(count, np.int64)
    places[numbers] = np.arange(count)
    faces = places[mesh.faces]
    faces = from_least(faces)
    faces = faces[_sorted(faces[:, 0] * count + faces[:, 1], faces[:, 2])]
    return Renumbered(Mesh(mesh.vertices[numbers], faces), numbers, places)


def from_least(faces: Ints) -> Ints:
    """Return faces, (m, 3), each with its corners from the least number on."""
    return np.take_along_axis(faces, (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)


def _sorted(keys: NDArray[Any], *further: NDArray[Any]) -> Ints:
    """Return indices that sort by keys, and where two are the same by further ones."""
    order = np.argsort(keys)
    repeated = (keys[order[1:]] == keys[order[:-1]]).any()  # else one sort will do, which takes a fifth of the time
    return np.asarray(np.lexsort((*further, keys)) if repeated else order)


def cache_misses(mesh: Mesh) -> float:
    """Count how often a cache lacks a vertex as face after face asks for its own, against the fewest possible."""
    cache = Cache()
    cache.ask(mesh.faces)
    return cache.misses(len(mesh.vertices))


class Cache:
    """Lines of memory with vertices, direct-mapped: of those that have one number modulo LINES the last one used."""

    def __init__(self) -> None:
        self._held, self._missed = np.full(LINES, -1, np.int64), 0

    def ask(self, faces: NDArray[Any]) -> None:
        """Let faces, (m, 3), ask for their vertices, one after the other."""
        self._missed += _ask(np.ascontiguousarray(faces, np.int32), self._held)

    def misses(self, vertices: int) -> float:
        """Return how often a line was not there, against the fewest possible for so many vertices."""
        return self._missed * LINE / vertices


@kernel
def _ask(faces: Ints32, held: Ints) -> int:
    """Count the vertices whose line is not held when a face asks for it; from then on it is."""
    missed = 0
    for f in range(len(faces)):
        for corner in range(3):
            line = faces[f, corner] // LINE
            if held[line % LINES] != line:
                held[line % LINES] = line
                missed += 1
    return missed


def morton_codes(points: Vectors) -> NDArray[np.uint64]:
    """Number the cells of a grid over points, (n, 3), along a curve that fills space; points far out go to its border.

    The bits of the three coordinates take turns.
    """
    return morton_codes_between(points, *np.quantile(points, [OUTLIERS, 1 - OUTLIERS], axis=0))


def morton_codes_between(points: Vectors, lower: Vectors, upper: Vectors) -> NDArray[np.uint64]:
    """Number the cells of a grid between two corners, (3,), of a box, as `morton_codes` does."""
    size = max(float((upper - lower).max()), np.finfo(float).tiny)
    cells = (np.clip((points - lower) / size, 0, 1) * (2**BITS - 1)).astype(np.uint64)
    codes = np.zeros(len(points), np.uint64)
    for axis in range(3):
        codes |= _spread(cells[:, axis]) << np.uint64(axis)
    return codes


def _spread(numbers: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Put two zeros above each of the BITS lowest bits."""
    for shift, mask in (
        (32, 0x001F00000000FFFF),
        (16, 0x001F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        numbers = (numbers | (numbers << np.uint64(shift))) & np.uint64(mask)
    return numbers
