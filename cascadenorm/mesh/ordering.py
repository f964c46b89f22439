"""Cache-friendly ordering of vertices and faces.

Every pass over a mesh gathers the values of neighbours. If the vertices or faces are shuffled, these values are
scattered in memory, and cache misses dominate the run time.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.arrays import Ints, Ints32, Vectors
from cascadenorm.compute.csr import Csr
from cascadenorm.compute.kernels import kernel
from cascadenorm.compute.threads import parallel_for
from cascadenorm.mesh.mesh import Mesh
from cascadenorm.mesh.topology import rows_with
from cascadenorm.mesh.topology_kernels import sort

CACHE_LINE = 8  # vertices in a line of the simulated cache
LINES = 512
POOR = 20.0
"""Ratio of cache misses to the fewest possible above which a mesh is renumbered.

Shuffled meshes have 30 to 48, meshes of scanners and marching cubes 1 to 17, renumbered meshes 1."""
OUTLIER_VERTICES = 0.001  # share of the vertices at either end that is ignored for the size of the cells
BITS = 21  # bits per coordinate in a Morton code
MASKS = 0x001F00000000FFFF, 0x001F0000FF0000FF, 0x100F00F00F00F00F, 0x10C30C30C30C30C3, 0x1249249249249249
# shifts and masks that insert two zeros between the bits of a coordinate
SPREADS = tuple((np.uint64(32 >> k), np.uint64(mask)) for k, mask in enumerate(MASKS))
LOWER = (1 << 32) - 1


class Renumbered(NamedTuple):
    """A mesh with reordered vertices and faces."""

    mesh: Mesh
    numbers: Ints  # (n,) original index of each vertex
    places: Ints32  # (n,) new index of each original vertex

    @classmethod
    def unchanged(cls, mesh: Mesh) -> "Renumbered":
        """Return a mesh in its present order."""
        own = np.arange(len(mesh.vertices))
        return cls(mesh, own, own.astype(np.int32))


def ordered_for_cache(mesh: Mesh) -> Renumbered:
    """Reorder vertices and faces along a space-filling curve, unless the order of the mesh is already good.

    Vertices are sorted by the Morton code of their position, then by position. Faces begin with their lowest vertex
    and are sorted by their corners. If no two vertices coincide, all poor orders of a mesh therefore give the same
    result.
    """
    count = len(mesh.vertices)
    if cache_misses(mesh) <= POOR:
        return Renumbered.unchanged(mesh)
    numbers = _sorted(morton_codes(mesh.vertices), mesh.vertices)
    places = np.empty(count, np.int32)
    places[numbers] = np.arange(count)
    renumbered, faces = np.empty_like(mesh.faces), np.empty_like(mesh.faces)
    parallel_for(len(faces), _renumber_range, mesh.faces, places, renumbered)
    parallel_for(count, _sort_range, renumbered, rows_with(renumbered[:, :1].copy(), count), faces)
    return Renumbered(Mesh(mesh.vertices[numbers], faces), numbers, places)


def _sorted(codes: NDArray[np.uint64], points: Vectors) -> Ints:
    """Return the indices that sort by code, then by position."""
    order = np.argsort(codes)
    repeated = (codes[order[1:]] == codes[order[:-1]]).any()  # otherwise one sort suffices
    return np.asarray(np.lexsort((*points.T, codes)) if repeated else order)


def cache_misses(mesh: Mesh) -> float:
    """Return the ratio of cache misses to the fewest possible when all faces read their vertices in order."""
    return _ask(mesh.faces, np.full(LINES, -1, np.int64)) * CACHE_LINE / len(mesh.vertices)


@kernel
def _ask(faces: Ints32, held: Ints) -> int:
    """Count the cache misses when all faces read their vertices."""
    missed = 0
    for f in range(len(faces)):
        for corner in range(3):
            line = faces[f, corner] // CACHE_LINE
            if held[line % LINES] != line:
                held[line % LINES] = line
                missed += 1
    return missed


def morton_codes(points: Vectors) -> NDArray[np.uint64]:
    """Return (n,) Morton codes of points, which interleave the bits of coordinates; outliers count as at the border."""
    lower, upper = np.quantile(points, [OUTLIER_VERTICES, 1 - OUTLIER_VERTICES], axis=0)
    size = max(float((upper - lower).max()), np.finfo(float).tiny)
    codes = (np.clip((points - lower) / size, 0, 1) * (2**BITS - 1)).astype(np.uint64)
    for shift, mask in SPREADS:
        codes = (codes | (codes << shift)) & mask
    x, y, z = codes.T
    return np.asarray(x | (y << np.uint64(1)) | (z << np.uint64(2)))


@kernel
def _renumber_range(start: int, stop: int, faces: Ints32, places: Ints32, out: Ints32) -> None:
    """Map faces to new vertex indices, and rotate each face to begin with its lowest index."""
    for f in range(start, stop):
        a, b, c = places[faces[f, 0]], places[faces[f, 1]], places[faces[f, 2]]
        if b < a and b <= c:
            a, b, c = b, c, a
        elif c < a and c < b:
            a, b, c = c, a, b
        out[f, 0], out[f, 1], out[f, 2] = a, b, c


@kernel
def _sort_range(start: int, stop: int, faces: Ints32, beginning: Csr, out: Ints32) -> None:
    """Write the sorted faces that begin with each vertex in start … stop."""
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
