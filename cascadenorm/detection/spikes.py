"""Detection and removal of spikes: single outlier vertices, as in photogrammetry."""

import numpy as np

from cascadenorm.detection.noise_level import noise_level
from cascadenorm.mesh import Bools, Csr, Ints32, Mesh, Vectors, kernel, parallel_for
from cascadenorm.mesh.vectors import Vector, add, divided, dot, length, row, subtract

HIGH = 1.5  # least height of a spike above the mean of its neighbours, divided by their mean distance from that mean
MOST_SPIKE_NEIGHBORS = 10  # largest number of neighbours of a spike; the tip of a tessellated cone has more
# Faces are not weighted by area, since the large faces of a neighbouring spike would dominate.
FLAT_BASE = 0.6  # least length of the mean normal of the faces around the neighbours: the surface below is nearly flat
UPRIGHT = 0.6  # least cosine of the angle between a spike and the normal of the surface below it
SPIKE_ROUNDS = 3  # largest number of passes that remove spikes
NOISE = 0.02  # least noise of the mesh in mean edge lengths; on cleaner meshes, spikes count as shape


def noise_spikes(mesh: Mesh) -> Bools:
    """Return (n,) whether each vertex is a spike.

    A spike rises above an otherwise nearly flat neighbourhood, higher than the radius of its base, as outliers on a
    noisy surface do. Boundary vertices are never spikes. `spikes` in `inspection.defects` are sharp tips of any cause.
    """
    topology = mesh.topology
    found = np.zeros(len(mesh.vertices), bool)
    parallel_for(len(found), _high_range, mesh.vertices, topology.vertex_neighbors, topology.vertex_faces, found)
    candidates = np.flatnonzero(found)
    standing = np.zeros(len(candidates), bool)
    parallel_for(
        len(candidates), _standing_range, candidates.astype(np.int32), mesh.vertices, mesh.faces, mesh.face_normals,
        topology.vertex_neighbors, topology.vertex_faces, standing,
    )  # fmt: skip
    found[candidates] = standing
    return found


def without_spikes(mesh: Mesh) -> Mesh:
    """Move each spike to the mean of its neighbours, in a few passes, unless the mesh has no significant noise."""
    for done in range(SPIKE_ROUNDS):
        found = noise_spikes(mesh)
        if not found.any() or (done == 0 and (noise_level(mesh) or 0.0) < NOISE):
            break
        vertices = mesh.vertices.copy()
        for i in np.flatnonzero(found):
            vertices[i] = mesh.vertices[mesh.topology.vertex_neighbors.row(int(i))].mean(axis=0)
        mesh = mesh.moved(vertices)
    return mesh


@kernel
def _mean(vertices: Vectors, around: Ints32) -> Vector:
    total = (0.0, 0.0, 0.0)
    for j in around:
        total = add(total, row(vertices, j))
    return divided(total, len(around))


@kernel
def _high_range(start: int, stop: int, vertices: Vectors, neighbors: Csr, vertex_faces: Csr, out: Bools) -> None:
    """Find interior vertices that are high above the mean of their neighbours."""
    for i in range(start, stop):
        around = neighbors.indices[neighbors.indptr[i] : neighbors.indptr[i + 1]]
        faces = vertex_faces.indptr[i + 1] - vertex_faces.indptr[i]
        out[i] = False
        if not 3 <= len(around) <= MOST_SPIKE_NEIGHBORS or faces != len(around):
            continue
        middle = _mean(vertices, around)
        radius = 0.0
        for j in around:
            radius += length(subtract(row(vertices, j), middle))
        out[i] = length(subtract(row(vertices, i), middle)) * len(around) > HIGH * radius


@kernel
def _standing_range(
    start: int,
    stop: int,
    candidates: Ints32,
    vertices: Vectors,
    faces: Ints32,
    normals: Vectors,
    neighbors: Csr,
    vertex_faces: Csr,
    out: Bools,
) -> None:
    """Find candidates that stand upright on nearly coplanar surrounding faces, ignoring their own faces."""
    for c in range(start, stop):
        i = candidates[c]
        around = neighbors.indices[neighbors.indptr[i] : neighbors.indptr[i + 1]]
        total, count = (0.0, 0.0, 0.0), 0
        for j in around:
            for k in range(vertex_faces.indptr[j], vertex_faces.indptr[j + 1]):
                f = vertex_faces.indices[k]
                if faces[f, 0] == i or faces[f, 1] == i or faces[f, 2] == i:
                    continue
                total = add(total, row(normals, f))
                count += 1
        size, up = length(total), subtract(row(vertices, i), _mean(vertices, around))
        out[c] = size > 0.0 and size >= FLAT_BASE * count and abs(dot(up, total)) > UPRIGHT * size * length(up)
