"""A bank of joint bilateral filters of face normals.

B-FND and G-FND consist of these filters (Wang, Liu, Tong 2016).
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cascadenorm.geometry.neighborhoods import within
from cascadenorm.mesh import Bools, Csr, Floats, Floats32, Mesh, Vectors, kernel, parallel_for
from cascadenorm.mesh.vectors import length, row, squared_distance

MOST_NEIGHBORS = 2048
"""Maximum number of neighbours of a filter, which limits the cost where tiny faces lie among much larger ones. Even
meshes have 180 for σ_s = 2."""
FACES_AT_A_TIME = 1 << 15  # number of faces whose neighbours are stored at a time


def filtered_normals(
    mesh: Mesh,
    guides: Vectors,
    *,
    sigma_s: tuple[float, ...],
    sigma_r: tuple[float, ...],
    cutoff: float,
    rings: int | None = None,
) -> NDArray[np.float32]:
    """Filter the face normals once by a joint bilateral filter for each σ_s and each σ_r.

    Parameters
    ----------
    guides
        (s, m, 3) unit normals, one field for each σ_s. The range weight depends on the chords between them.
    sigma_s, sigma_r
        Spreads of the distance, in mean edge lengths, and of chords between unit normals. Infinity disables the range
        weight.
    cutoff
        Radius of each filter in units of σ_s. The filter sums over faces with centroids within this radius that are
        connected to the face by such faces, at most MOST_NEIGHBORS. A disk of 2.5 σ_s covers 96 % of the Gaussian.
    rings
        Number of rings of faces to sum over instead. Two rings cover less than half of the Gaussian at σ_s = 2.

    Returns ------- (m, s · r, 3) float32 unit normals, σ_r ascending within σ_s ascending. Where a sum vanishes, the
    face normal is kept.
    """
    out = np.empty((len(mesh.faces), len(sigma_s) * len(sigma_r), 3), np.float32)
    spatial = 0.5 / (np.array(sigma_s) * mesh.mean_edge_length) ** 2
    spreads = 0.5 / np.array(sigma_r) ** 2
    farthest = cutoff if rings is None else np.inf
    guides = np.ascontiguousarray(guides)
    for first, neighbors in _neighbors(mesh, cutoff * max(sigma_s) * mesh.mean_edge_length, rings):
        parallel_for(
            len(neighbors.counts), _filter_range, first, mesh.face_normals, guides, mesh.centroids, mesh.areas,
            neighbors, spatial, spreads, 0.5 * farthest**2, out,
        )  # fmt: skip
    return out


def faces_added(mesh: Mesh, faces: Bools, *, sigma_s: tuple[float, ...], cutoff: float) -> Bools:
    """Return the faces, (m,), that `filtered_normals` sums over for the given faces, (m,), which are included."""
    radius, graph = cutoff * max(sigma_s) * mesh.mean_edge_length, mesh.topology.face_rings(1)
    found, every = faces.copy(), np.flatnonzero(faces).astype(np.int32)
    for first in range(0, len(every), FACES_AT_A_TIME):
        rows = every[first : first + FACES_AT_A_TIME]
        themselves = Csr(np.arange(len(rows) + 1, dtype=np.int64), rows)
        radii = np.full(len(rows), radius)
        near = within(mesh.centroids[rows], radii, mesh.centroids, graph, themselves, most=MOST_NEIGHBORS)
        found[near.indices] = True
    return found


def _neighbors(mesh: Mesh, radius: float, rings: int | None) -> Iterator[tuple[int, Csr]]:
    """Yield the number of the first face and the neighbours of a block of faces, within a radius or rings.

    Neighbours within a radius are found by a traversal over faces that share a vertex. It starts at the face itself and
    includes it.
    """
    if rings is not None:
        yield 0, mesh.topology.face_rings(rings)
        return
    graph, count = mesh.topology.face_rings(1), len(mesh.faces)
    for first in range(0, count, FACES_AT_A_TIME):
        rows = np.arange(first, min(first + FACES_AT_A_TIME, count), dtype=np.int32)
        themselves = Csr(np.arange(len(rows) + 1, dtype=np.int64), rows)
        radii = np.full(len(rows), radius)
        yield first, within(mesh.centroids[rows], radii, mesh.centroids, graph, themselves, most=MOST_NEIGHBORS)


@kernel
def _filter_range(
    start: int,
    stop: int,
    first: int,
    normals: Vectors,
    guides: Floats,
    centroids: Vectors,
    areas: Floats,
    neighbors: Csr,
    spatial: Floats,
    spreads: Floats,
    largest: float,
    out: Floats32,
) -> None:
    """Compute all filters of face first + i in one pass over its neighbours. Only iteration i writes its row."""
    count_s, count_r = len(spatial), len(spreads)
    total = np.empty((count_s, count_r, 3))
    for i in range(start, stop):
        # The face itself has distance 0.
        f = first + i
        for s in range(count_s):
            for r in range(count_r):
                for d in range(3):
                    total[s, r, d] = areas[f] * normals[f, d]

        # Neighbours: the spatial weight is shared by all range spreads, the chord by all filters with the same guide.
        # Neighbours whose spatial exponent exceeds `largest` are skipped.
        for k in range(neighbors.indptr[i], neighbors.indptr[i + 1]):
            g = neighbors.indices[k]
            if g == f:
                continue
            distance = squared_distance(row(centroids, g), row(centroids, f))
            for s in range(count_s):
                u = spatial[s] * distance
                if u > largest:
                    continue
                near = areas[g] * np.exp(-u)
                chord = squared_distance(row(guides[s], g), row(guides[s], f))
                for r in range(count_r):
                    w = near if spreads[r] == 0 else near * np.exp(-spreads[r] * chord)
                    for d in range(3):
                        total[s, r, d] += w * normals[g, d]

        # Normalise the sums.
        for s in range(count_s):
            for r in range(count_r):
                size = length(row(total[s], r))
                for d in range(3):
                    out[f, s * count_r + r, d] = total[s, r, d] / size if size > 0 else normals[f, d]
