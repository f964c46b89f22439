"""Detection and removal of single outlier vertices: spikes on noisy surfaces, and outliers on smooth ones."""

import numpy as np

from cascadenorm.detection.noise_level import noise_level
from cascadenorm.mesh import Bools, Csr, Floats, Ints32, Mesh, Vectors, kernel, marked, parallel_for
from cascadenorm.mesh.topology_kernels import sort
from cascadenorm.mesh.vectors import Vector, add, divided, dot, length, row, subtract

HIGH = 1.5  # smallest height of a spike above the mean of its neighbours, relative to their mean distance from it
MOST_NEIGHBORS = 10  # of a spike or a neighbour of an outlier; tips of cones and corners of CAD parts have more
# Faces are not weighted by area, since the large faces of a neighbouring spike would dominate.
FLAT_BASE = 0.6  # smallest length of the mean normal of the faces around the neighbours, 1 if these are coplanar
UPRIGHT = 0.6  # smallest cosine of the angle between a spike and the normal of the surface below it
NOISE = 0.02  # smallest noise of the mesh in mean edge lengths; on cleaner meshes, spikes count as shape

OUTSTANDING = 8.0  # smallest offset of an outlier, in median deviations of the heights within two edges
LEAST_OFFSET = 0.05  # smallest offset of an outlier, relative to the length of its edges
CLEARLY = 2.0  # smallest offset, in mean deviations of the neighbours, according to a quick estimate
EXPLAINED = 0.75  # smallest share of the deviations of its neighbours that the offset explains
FEWEST_NEIGHBORS = 5  # of an outlier; vertices with fewer neighbours are rare and mostly irregular

IMPULSIVE = 0.005  # share of outliers from which the noise of a component counts as impulsive
FEWEST_FACES = 100  # of a component with spikes or outliers; every vertex of a tetrahedron stands out
ROUNDS = 3  # largest number of passes that move spikes or outliers


def noise_spikes(mesh: Mesh) -> Bools:
    """Return (n,) whether each vertex is a spike.

    A spike rises above an otherwise nearly flat neighbourhood, higher than the radius of its base, as outliers on a
    noisy surface do. Boundary vertices are never spikes. `spikes` in `inspection.defects` are sharp tips of any cause.
    """
    topology = mesh.topology
    found = np.zeros(len(mesh.vertices), bool)
    parallel_for(len(found), _high_range, mesh.vertices, topology.vertex_neighbors, topology.vertex_faces, found)
    return _standing(mesh, found)


def _standing(mesh: Mesh, found: Bools) -> Bools:
    """Return which of the found vertices, (n,), stand upright on a nearly flat surface, in a large enough component."""
    if not found.any():
        return found
    topology, candidates = mesh.topology, np.flatnonzero(found)
    sizes = np.bincount(topology.face_components)
    candidates = candidates[sizes[topology.components[candidates]] >= FEWEST_FACES]
    standing = np.zeros(len(candidates), bool)
    parallel_for(
        len(candidates), _standing_range, candidates.astype(np.int32), mesh.vertices, mesh.faces, mesh.face_normals,
        topology.vertex_neighbors, topology.vertex_faces, standing,
    )  # fmt: skip
    return marked(candidates[standing], len(found))


def without_outliers(mesh: Mesh) -> Mesh:
    """Return a mesh without spikes, with all other outliers moved to the level of their surroundings."""
    mesh = without_spikes(mesh)
    for _ in range(ROUNDS):
        offsets = outlier_offsets(mesh)
        if not offsets.any():
            break
        mesh = mesh.moved(mesh.vertices - offsets)
    return mesh


def outliers(mesh: Mesh) -> Bools:
    """Return (n,) whether each vertex is a spike or another outlier."""
    return _moved(mesh, without_outliers(mesh))


def _moved(before: Mesh, after: Mesh) -> Bools:
    return np.asarray((before.vertices != after.vertices).any(axis=1))


def impulsive(noisy: Mesh, mesh: Mesh) -> Bools:
    """Return (n,) whether each vertex is in a component with impulsive noise, from which outliers were removed."""
    components = mesh.topology.components
    shares = np.bincount(components, _moved(noisy, mesh)) / np.bincount(components)
    return np.asarray(shares[components] >= IMPULSIVE)


def outlier_offsets(mesh: Mesh) -> Vectors:
    """Return how far outliers are off an otherwise smooth surface, (n, 3) along the normals; 0 for other vertices.

    The height of a vertex is measured above the mean of its neighbours. A vertex that is off by d raises its own height
    by d, and lowers that of a neighbour with k neighbours by d / k. An outlier has a height far from the median within
    two edges, and its offset explains the heights of its neighbours. Those of corners, creases and noise do not.
    """
    topology, count = mesh.topology, len(mesh.vertices)
    normals, heights, spacings = np.empty((count, 3)), np.empty(count), np.empty(count)
    around = topology.vertex_neighbors
    parallel_for(count, _height_range, mesh.vertices, mesh.vertex_normals, around, normals, heights, spacings)
    offsets = np.empty(count)
    parallel_for(count, _offset_range, heights, spacings, around, topology.vertex_faces, offsets)
    return np.asarray(np.where(_standing(mesh, offsets != 0), offsets, 0)[:, None] * normals)


def without_spikes(mesh: Mesh) -> Mesh:
    """Move each spike to the mean of its neighbours, in a few passes, unless the mesh has no significant noise."""
    for done in range(ROUNDS):
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
    return divided(total, float(len(around)))


@kernel
def _high_range(start: int, stop: int, vertices: Vectors, neighbors: Csr, vertex_faces: Csr, out: Bools) -> None:
    """Find interior vertices that are high above the mean of their neighbours."""
    for i in range(start, stop):
        around = neighbors.indices[neighbors.indptr[i] : neighbors.indptr[i + 1]]
        faces = vertex_faces.indptr[i + 1] - vertex_faces.indptr[i]
        out[i] = False
        if not 3 <= len(around) <= MOST_NEIGHBORS or faces != len(around):
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


@kernel
def _height_range(
    start: int,
    stop: int,
    vertices: Vectors,
    vertex_normals: Vectors,
    neighbors: Csr,
    normals: Vectors,
    heights: Floats,
    spacings: Floats,
) -> None:
    """Write the mean normal of the neighbours, the height above their mean, and their mean distance."""
    for i in range(start, stop):
        around = neighbors.indices[neighbors.indptr[i] : neighbors.indptr[i + 1]]
        up, here, distance = (0.0, 0.0, 0.0), row(vertices, i), 0.0
        for j in around:
            up = add(up, row(vertex_normals, j))
            distance += length(subtract(row(vertices, j), here))
        size = length(up)
        up = divided(up, size) if size > 0.0 else up
        normals[i, 0], normals[i, 1], normals[i, 2] = up
        heights[i] = dot(subtract(here, _mean(vertices, around)), up) if len(around) else 0.0
        spacings[i] = distance / max(len(around), 1)


@kernel
def _offset_range(
    start: int, stop: int, heights: Floats, spacings: Floats, neighbors: Csr, vertex_faces: Csr, out: Floats
) -> None:
    """Write the offset of interior vertices that are outliers, and 0 for all others."""
    for i in range(start, stop):
        out[i] = 0.0
        around = neighbors.indices[neighbors.indptr[i] : neighbors.indptr[i + 1]]
        if len(around) < FEWEST_NEIGHBORS or vertex_faces.indptr[i + 1] - vertex_faces.indptr[i] != len(around):
            continue

        # A quick estimate of the level and the offset rules out most vertices
        mean, deviation, most, count = 0.0, 0.0, 0, 0
        for j in around:
            mean += heights[j] / len(around)
            most = max(most, neighbors.indptr[j + 1] - neighbors.indptr[j])
            count += neighbors.indptr[j + 1] - neighbors.indptr[j]
        offset = (heights[i] - mean) / (1.0 + 1.0 / len(around))
        for j in around:
            deviation += abs(heights[j] - heights[i] + offset) / len(around)
        least = LEAST_OFFSET * spacings[i]
        if most > MOST_NEIGHBORS or abs(offset) <= max(CLEARLY * deviation, least):
            continue

        nearby, count = np.empty(count), 0
        for j in around:
            for k in range(neighbors.indptr[j], neighbors.indptr[j + 1]):
                nearby[count] = heights[neighbors.indices[k]]
                count += 1
        level = _sorted_median(nearby)
        deviation = _sorted_median(np.abs(nearby - level))
        offset = heights[i] - level
        outstanding = abs(offset) > max(OUTSTANDING * deviation, least)
        if outstanding and _explains(offset, level, around, heights, neighbors):
            out[i] = offset


@kernel
def _sorted_median(values: Floats) -> float:
    """Sort values in place and return their median; numpy's median takes longer to compile."""
    sort(values)
    middle = len(values) // 2
    median: float = values[middle] if len(values) % 2 else 0.5 * (values[middle - 1] + values[middle])
    return median


@kernel
def _explains(offset: float, level: float, around: Ints32, heights: Floats, neighbors: Csr) -> bool:
    """Whether the neighbours of a vertex come close enough to the level without its offset."""
    gain = possible = 0.0
    for j in around:
        share = offset / (neighbors.indptr[j + 1] - neighbors.indptr[j])
        gain += abs(heights[j] - level) - abs(heights[j] + share - level)
        possible += abs(share)
    return gain > EXPLAINED * possible
