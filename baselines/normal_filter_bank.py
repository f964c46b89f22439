"""A bank of joint bilateral filters of face normals.

B-FND and G-FND consist of these filters (Wang, Liu, Tong 2016).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.elementary import expf
from cascadenorm.compute.kernels import inlined_sum
from cascadenorm.geometry.neighborhoods import GroupSearch, faces_near, group_search, search_faces, search_group
from cascadenorm.mesh import (
    SMALLEST_COSTLY_CHUNK,
    Bools,
    Csr,
    Floats,
    Floats32,
    Ints,
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
LARGEST_GROUP = 16  # number of faces whose neighbours are searched together; even meshes have 12 that touch a face
USUAL_GROUP = 8  # most groups are smaller, since faces belong to earlier ones
FACES_AT_A_TIME = 1 << 15  # number of faces whose neighbours are stored at a time


def filtered_normals(
    mesh: Mesh, guides: Floats | Floats32, *, sigma_s: tuple[float, ...], sigma_r: tuple[float, ...], cutoff: float
) -> NDArray[np.float32]:
    """Filter the face normals once by a joint bilateral filter for each σ_s and each σ_r.

    The guides are (s, m, 3) unit normals, one field for each σ_s; the range weight depends on the chords between them.
    σ_s are spreads of the distance in mean edge lengths, σ_r those of the chords; infinity disables the range weight. A
    filter sums over the faces with centroids within `cutoff` σ_s that are connected to the face by such faces, at most
    MOST_NEIGHBORS. A disk of 2.5 σ_s covers 96 % of the Gaussian. Returns (m, s · r, 3) float32 unit normals, σ_r
    ascending within σ_s ascending. Where a sum vanishes, the face normal is kept.
    """
    out = np.empty((len(mesh.faces), len(sigma_s) * len(sigma_r), 3), np.float32)
    radius = filter_radius(mesh, sigma_s, cutoff)
    members, starts = _groups(mesh.faces, mesh.topology.vertex_faces, mesh.centroids, radius**2)
    parallel_for(
        len(starts) - 1, _filter_range, members, starts, mesh.faces, mesh.topology.vertex_faces, mesh.centroids,
        (mesh.area_vectors / mesh.median_area).astype(np.float32), mesh.face_normals,
        np.ascontiguousarray(guides, np.float32), 0.5 / (np.array(sigma_s) * mesh.mean_edge_length) ** 2,
        (0.5 / np.array(sigma_r) ** 2).astype(np.float32), 0.5 * cutoff**2, radius,
        out, smallest=SMALLEST_COSTLY_CHUNK // USUAL_GROUP,
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


@inlined_sum
def _weighted_sum(count: int, weight: Floats32, x: Floats32, y: Floats32, z: Floats32) -> tuple[Any, Any, Any]:
    """Return the weighted sums of three components."""
    a = b = c = np.float32(0)
    for k in range(count):
        a += weight[k] * x[k]
        b += weight[k] * y[k]
        c += weight[k] * z[k]
    return a, b, c


@kernel
def _groups(faces: Ints32, around: Csr, centroids: Vectors, limit: float) -> tuple[Ints32, Ints]:
    """Divide the faces into groups that are searched together.

    Returns
    -------
    (m,) members of all groups and (g + 1,) start of each group. The members of a group share a vertex with the first
    one, and the squared distance from it is within the limit.
    """
    members, starts = np.empty(len(faces), np.int32), np.zeros(len(faces) + 1, np.int64)
    taken = np.zeros(len(faces), np.bool_)
    end = count = 0
    for f in range(len(faces)):
        if taken[f]:
            continue
        first = end
        members[end], taken[f], end = f, True, end + 1
        for corner in range(3):
            v = faces[f, corner]
            for k in range(around.indptr[v], around.indptr[v + 1]):
                g = around.indices[k]
                near = squared_distance(row(centroids, g), row(centroids, f)) <= limit
                if near and not taken[g] and end - first < LARGEST_GROUP:
                    members[end], taken[g], end = g, True, end + 1
        count += 1
        starts[count] = end
    return members, starts[: count + 1]


@kernel
def _filter_range(
    start: int,
    stop: int,
    members: Ints32,
    starts: Ints,
    faces: Ints32,
    around: Csr,
    centroids: Vectors,
    vectors: Floats32,
    normals: Vectors,
    guides: Floats32,
    spatial: Floats,
    spreads: Floats32,
    largest: float,
    radius: float,
    out: Floats32,
) -> None:
    """Compute all filters of each face of some groups. Only its group writes row f.

    The area vectors, (m, 3), are in any unit. `spatial` and `spreads` are the factors of the squared distance and of
    the squared chord in the exponent. Faces with a spatial exponent above `largest` are left out; `radius` limits the
    search.
    """
    search = group_search(len(faces), len(around.indptr) - 1, MOST_NEIGHBORS)
    seen = np.full(len(faces), -1, np.int32), np.full(len(around.indptr) - 1, -1, np.int32)
    for group in range(start, stop):
        some = members[starts[group] : starts[group + 1]]
        extent = 0.0
        for f in some:
            extent = max(extent, np.sqrt(squared_distance(row(centroids, f), row(centroids, some[0]))))
        count = search_group(some, extent, faces, around, centroids, radius, search)
        if count >= 0:
            _filter_members(
                some, extent, count, search, centroids, vectors, normals, guides, spatial, spreads, largest, out
            )
            continue

        # too many faces for a group: search around each member alone, up to MOST_NEIGHBORS
        for i in range(len(some)):
            count = search_faces(some[i], faces, around, centroids, radius**2, seen, search.found, search.squared)
            search.reached[:count] = 1
            _filter_members(
                some[i : i + 1], 0.0, count, search, centroids, vectors, normals, guides, spatial, spreads, largest, out
            )


@kernel
def _filter_members(
    members: Ints32,
    extent: float,
    count: int,
    search: GroupSearch,
    centroids: Vectors,
    vectors: Floats32,
    normals: Vectors,
    guides: Floats32,
    spatial: Floats,
    spreads: Floats32,
    largest: float,
    out: Floats32,
) -> None:
    """Compute all filters of the members of a group from the `count` faces of its search."""
    # Exponents of both weights, whether a face counts, the weights, and components of area vectors and guides. Unpacked
    # rows would not count as contiguous, and their sums would not be vectorised.
    work, centers = np.empty((10, count), np.float32), np.empty((3, count))
    u, chord, counts, weight = work[0], work[1], work[2], work[3]
    x, y, z, gx, gy, gz = work[4], work[5], work[6], work[7], work[8], work[9]
    cx, cy, cz = centers[0], centers[1], centers[2]
    near, reached = np.empty(count, np.int32), np.empty(count, np.int32)
    for s in range(len(spatial)):
        # the faces that may be within this σ_s of a member; all σ_r share them
        factor, size = spatial[s], 0
        reach = (1.000001 * np.sqrt(largest / factor) + extent) ** 2
        for k in range(count):
            near[size] = k
            size += search.squared[k] <= reach
        for k in range(size):
            g, reached[k] = search.found[near[k]], search.reached[near[k]]
            cx[k], cy[k], cz[k] = row(centroids, g)
            x[k], y[k], z[k] = vectors[g, 0], vectors[g, 1], vectors[g, 2]
            gx[k], gy[k], gz[k] = guides[s, g, 0], guides[s, g, 1], guides[s, g, 2]

        for member in range(len(members)):
            f = members[member]
            px, py, pz = row(centroids, f)
            hx, hy, hz = guides[s, f, 0], guides[s, f, 1], guides[s, f, 2]
            for k in range(size):
                exponent = factor * ((cx[k] - px) ** 2 + (cy[k] - py) ** 2 + (cz[k] - pz) ** 2)
                u[k], counts[k] = exponent, (exponent <= largest) & ((reached[k] >> member) & 1)
                chord[k] = (gx[k] - hx) ** 2 + (gy[k] - hy) ** 2 + (gz[k] - hz) ** 2
            for r, steepness in enumerate(spreads):
                for k in range(size):
                    weight[k] = expf(-(u[k] + steepness * chord[k])) * counts[k]
                total = _weighted_sum(size, weight, x, y, z)
                length = np.sqrt(total[0] * total[0] + total[1] * total[1] + total[2] * total[2])
                column = s * len(spreads) + r
                for d in range(3):
                    out[f, column, d] = total[d] / length if length > 0 else normals[f, d]
