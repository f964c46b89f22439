"""A bank of joint bilateral filters of face normals.

B-FND and G-FND consist of these filters (Wang, Liu, Tong 2016).
"""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.elementary import expf
from cascadenorm.geometry.neighborhoods import UNLIMITED, faces_near, search_faces
from cascadenorm.mesh import (
    SMALLEST_COSTLY_CHUNK,
    Bools,
    Csr,
    Floats,
    Floats32,
    Ints32,
    Mesh,
    Vectors,
    kernel,
    parallel_for,
)
from cascadenorm.mesh.vectors import row, squared_distance

MOST_NEIGHBORS = 2048
"""Maximum number of faces of a filter, which limits the cost where tiny faces lie among much larger ones. Even meshes
have 180 for σ_s = 2."""
FACES_AT_A_TIME = 1 << 15  # number of faces whose neighbours are stored at a time


def filtered_normals(
    mesh: Mesh,
    guides: Floats | Floats32,
    *,
    sigma_s: tuple[float, ...],
    sigma_r: tuple[float, ...],
    cutoff: float,
    rings: int | None = None,
) -> NDArray[np.float32]:
    """Filter the face normals once by a joint bilateral filter for each σ_s and each σ_r.

    The guides are (s, m, 3) unit normals, one field for each σ_s; the range weight depends on the chords between them.
    σ_s are spreads of the distance in mean edge lengths, σ_r those of the chords; infinity disables the range weight. A
    filter sums over the faces with centroids within `cutoff` σ_s that are connected to the face by such faces, at most
    MOST_NEIGHBORS. A disk of 2.5 σ_s covers 96 % of the Gaussian. If `rings` is given, the filter sums over that many
    rings of faces instead; two rings cover less than half of the Gaussian at σ_s = 2. Returns (m, s · r, 3) float32
    unit normals, σ_r ascending within σ_s ascending. Where a sum vanishes, the face normal is kept.
    """
    out = np.empty((len(mesh.faces), len(sigma_s) * len(sigma_r), 3), np.float32)
    radius = filter_radius(mesh, sigma_s, cutoff) if rings is None else np.inf
    parallel_for(
        len(out), _filter_range, mesh.faces, mesh.topology.vertex_faces, mesh.centroids,
        (mesh.area_vectors / mesh.median_area).astype(np.float32), mesh.face_normals,
        np.ascontiguousarray(guides, np.float32), 0.5 / (np.array(sigma_s) * mesh.mean_edge_length) ** 2,
        (0.5 / np.array(sigma_r) ** 2).astype(np.float32), 0.5 * cutoff**2 if rings is None else np.inf,
        radius**2, UNLIMITED if rings is None else rings, out, smallest=SMALLEST_COSTLY_CHUNK,
    )  # fmt: skip
    return out


def filter_radius(mesh: Mesh, sigma_s: tuple[float, ...], cutoff: float) -> float:
    """Return the radius of the widest filter in mesh units."""
    return cutoff * max(sigma_s) * mesh.mean_edge_length


def faces_added(mesh: Mesh, faces: Bools, *, sigma_s: tuple[float, ...], cutoff: float) -> Bools:
    """Return the faces, (m,), that `filtered_normals` sums over for the given faces, (m,), which are included."""
    radius, found, every = filter_radius(mesh, sigma_s, cutoff), faces.copy(), np.flatnonzero(faces).astype(np.int32)
    for first in range(0, len(every), FACES_AT_A_TIME):
        rows = every[first : first + FACES_AT_A_TIME]
        found[faces_near(mesh, rows, radius, most=MOST_NEIGHBORS).indices] = True
    return found


@kernel
def _filter_range(
    start: int,
    stop: int,
    faces: Ints32,
    around: Csr,
    centroids: Vectors,
    vectors: Floats32,
    normals: Vectors,
    guides: Floats32,
    spatial: Floats,
    spreads: Floats32,
    largest: float,
    limit: float,
    rings: int,
    out: Floats32,
) -> None:
    """Compute all filters of each face. Only iteration f writes row f.

    The area vectors, (m, 3), are in any unit. `spatial` and `spreads` are the factors of the squared distance and of
    the squared chord in the exponent. Faces with a spatial exponent above `largest` are left out; `limit` and `rings`
    are as in `search_faces`.
    """
    seen = np.full(len(faces), -1, np.int32), np.full(len(around.indptr) - 1, -1, np.int32)
    found, distances = np.empty(MOST_NEIGHBORS, np.int32), np.empty(MOST_NEIGHBORS)
    # exponents of both weights, the weights, and the area vectors of the neighbours, one array for each component
    u, chord, weight, x, y, z = np.empty((6, MOST_NEIGHBORS), np.float32)
    for f in range(start, stop):
        count = search_faces(f, faces, around, centroids, limit, rings, seen, found, distances)
        for s in range(len(spatial)):
            # All σ_r share the neighbours of a σ_s.
            near = 0
            for k in range(count):
                exponent, g = spatial[s] * distances[k], found[k]
                if exponent <= largest:
                    u[near], chord[near] = exponent, squared_distance(row(guides[s], g), row(guides[s], f))
                    x[near], y[near], z[near] = vectors[g, 0], vectors[g, 1], vectors[g, 2]
                    near += 1

            # A loop over the weights alone is vectorised.
            for r in range(len(spreads)):
                for k in range(near):
                    weight[k] = expf(-(u[k] + spreads[r] * chord[k]))
                total = np.float32(0), np.float32(0), np.float32(0)
                for k in range(near):
                    total = total[0] + weight[k] * x[k], total[1] + weight[k] * y[k], total[2] + weight[k] * z[k]
                size = np.sqrt(total[0] * total[0] + total[1] * total[1] + total[2] * total[2])
                column = s * len(spreads) + r
                for d in range(3):
                    out[f, column, d] = total[d] / size if size > 0 else normals[f, d]
