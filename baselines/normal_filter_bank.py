"""A bank of joint bilateral filters of face normals, of which B-FND and G-FND consist (Wang, Liu, Tong 2016)."""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Csr, Floats, Floats32, Mesh, Vectors, kernel, parallel_for
from cascadenorm.mesh.vectors import length, row, squared_distance


def filtered_normals(
    mesh: Mesh, guides: Vectors, *, sigma_s: tuple[float, ...], sigma_r: tuple[float, ...], rings: int
) -> NDArray[np.float32]:
    """Filter the face normals once by a joint bilateral filter for each σ_s and each σ_r.

    Parameters
    ----------
    mesh : m faces
    guides : (s, m, 3), one field of unit normals for each σ_s, between which the range weight measures the chord
    sigma_s : spatial spreads, in mean edge lengths
    sigma_r : range spreads, chords between unit normals; infinity leaves the range weight out
    rings : how far the neighbourhood of a face goes

    Returns
    -------
    (m, s · r, 3) float32 unit normals, σ_r ascending within σ_s ascending; a sum that vanishes keeps the face normal
    """
    neighbors = mesh.topology.face_rings(rings)
    out = np.empty((len(mesh.faces), len(sigma_s) * len(sigma_r), 3), np.float32)
    spatial = 0.5 / (np.array(sigma_s) * mesh.mean_edge_length) ** 2
    spreads = 0.5 / np.array(sigma_r) ** 2
    parallel_for(
        len(mesh.faces), _filter_range, mesh.normals, np.ascontiguousarray(guides), mesh.centroids, mesh.areas,
        neighbors, spatial, spreads, out,
    )  # fmt: skip
    return out


@kernel
def _filter_range(
    start: int,
    stop: int,
    normals: Vectors,
    guides: Floats,
    centroids: Vectors,
    areas: Floats,
    rings: Csr,
    spatial: Floats,
    spreads: Floats,
    out: Floats32,
) -> None:
    """All filters of a face in one walk over its neighbours; iteration f alone writes out[f]."""
    count_s, count_r = len(spatial), len(spreads)
    total = np.empty((count_s, count_r, 3))
    for f in range(start, stop):
        # the face itself, at no distance
        for s in range(count_s):
            for r in range(count_r):
                for d in range(3):
                    total[s, r, d] = areas[f] * normals[f, d]

        # its neighbours: the spatial weight is the same for all range spreads, the chord for all of one guide
        for k in range(rings.indptr[f], rings.indptr[f + 1]):
            g = rings.indices[k]
            distance = squared_distance(row(centroids, g), row(centroids, f))
            for s in range(count_s):
                near = areas[g] * np.exp(-spatial[s] * distance)
                chord = squared_distance(row(guides[s], g), row(guides[s], f))
                for r in range(count_r):
                    w = near if spreads[r] == 0 else near * np.exp(-spreads[r] * chord)
                    for d in range(3):
                        total[s, r, d] += w * normals[g, d]

        # at length 1
        for s in range(count_s):
            for r in range(count_r):
                size = length(row(total[s], r))
                for d in range(3):
                    out[f, s * count_r + r, d] = total[s, r, d] / size if size > 0 else normals[f, d]
