"""Farthest point sampling by geodesic distance."""

import heapq
from typing import NamedTuple

import numpy as np

from cascadenorm.errors import ParameterError
from cascadenorm.mesh import Bools, Csr, Floats, Ints, Ints32, Mesh, in_frame, kernel, without_lines
from cascadenorm.registry import checked_number

PROGRESS = 1e-12  # smallest relative decrease of a distance that is propagated


class UnfoldedFaces(NamedTuple):
    """Faces unfolded into their planes; side 3f + k of face f joins its corners k and k + 1."""

    faces: Ints32  # (m, 3)
    lengths: Floats  # (3m,) lengths of the sides
    # (3m, 2) third corner of the face in coordinates along and perpendicular to the side, from its first corner
    apexes: Floats
    vertex_faces: Csr  # faces around each vertex


def farthest_points(mesh: Mesh, count: int, *, first: int | None = None) -> Ints:
    """Sample vertices of a mesh, each as far as possible along the surface from all previous samples.

    Distances are computed by fast marching with unfolding (Kimmel & Sethian 1998; Novotni & Klein 2002), within about
    1 % of the exact ones. Each sample visits only the vertices to which it is nearer than all previous samples.

    Parameters
    ----------
    mesh
        Mesh with n vertices.
    count
        Number of samples, from 1 to the number of vertices with a face. Each connected component gets one sample before
        any component gets its second.
    first
        Index of the first sample. None selects the first vertex with a face.

    Returns
    -------
    (count,) vertex indices in the order of selection; fewer if all other vertices coincide with a sample.

    Raises
    ------
    ParameterError
        `count` is out of range, or `first` is not a vertex with a face.
    """
    mesh, _ = in_frame(without_lines(mesh))
    used = np.flatnonzero(mesh.topology.used_vertices)
    count = checked_number("count", int, count)
    if not 1 <= count <= len(used):
        raise ParameterError(
            f"is {count}; it must be from 1 to {len(used)}, the number of vertices that have a face", parameter="count"
        )
    start = int(used[0]) if first is None else checked_number("first", int, first)
    if start not in used:
        raise ParameterError(f"is {first}; it must be a vertex that a face references", parameter="first")
    return spread_samples(mesh, count, first=start)[0]


def spread_samples(mesh: Mesh, count: int, *, first: int) -> tuple[Ints, Floats]:
    """Return samples as `farthest_points` does, and each vertex's distance to the nearest; inf without a face."""
    samples, distances = np.empty(count, np.int64), np.full(len(mesh.vertices), np.inf)
    nearest = np.full(len(mesh.vertices), -1)  # nearest sample of each vertex
    found = _spread(_unfolded(mesh), mesh.topology.used_vertices, first, samples, nearest, distances)
    return samples[:found], distances


def _unfolded(mesh: Mesh) -> UnfoldedFaces:
    along, back = np.roll(mesh.corners, -1, axis=1) - mesh.corners, np.roll(mesh.corners, -2, axis=1) - mesh.corners
    lengths = np.linalg.norm(along, axis=2)
    apexes = np.zeros((*lengths.shape, 2))
    np.divide(np.einsum("fkd,fkd->fk", along, back), lengths, out=apexes[..., 0], where=lengths > 0)
    np.divide(2 * mesh.areas[:, None], lengths, out=apexes[..., 1], where=lengths > 0)
    return UnfoldedFaces(mesh.faces, lengths.ravel(), apexes.reshape(-1, 2), mesh.topology.vertex_faces)


@kernel
def _spread(unfolded: UnfoldedFaces, used: Bools, first: int, samples: Ints, nearest: Ints, distances: Floats) -> int:
    """Choose samples one by one, updating only the vertices nearest to the new sample; return their number."""
    center = first
    for s in range(len(samples)):
        samples[s] = center
        _march(unfolded, center, nearest, distances)
        farthest = 0.0
        for i in range(len(distances)):
            if used[i] and distances[i] > farthest:
                farthest, center = distances[i], i
        if not farthest > 0.0:
            return s + 1
    return len(samples)


@kernel
def _march(unfolded: UnfoldedFaces, center: int, nearest: Ints, distances: Floats) -> None:
    """Update distances by fast marching from a vertex."""
    faces, lengths, around = unfolded.faces, unfolded.lengths, unfolded.vertex_faces
    distances[center], nearest[center] = 0.0, center
    queue = [(0.0, np.int64(center))]
    while len(queue) > 0:
        distance, i = heapq.heappop(queue)
        if distance > distances[i]:
            continue
        for n in range(around.indptr[i], around.indptr[i + 1]):
            f = around.indices[n]
            k = 0 if faces[f, 0] == i else 1 if faces[f, 1] == i else 2
            b, c = faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
            # along both edges, and across the face from the side at this vertex if its other end has the same sample
            to_b, to_c = distance + lengths[3 * f + k], distance + lengths[3 * f + (k + 2) % 3]
            if nearest[c] == center:
                to_b = min(to_b, _across(unfolded, 3 * f + (k + 2) % 3, distances))
            if nearest[b] == center:
                to_c = min(to_c, _across(unfolded, 3 * f + k, distances))
            for v, to_v in ((b, to_b), (c, to_c)):
                if to_v < distances[v] * (1.0 - PROGRESS):
                    distances[v], nearest[v] = to_v, center
                    heapq.heappush(queue, (to_v, np.int64(v)))


@kernel
def _across(unfolded: UnfoldedFaces, side: int, distances: Floats) -> float:
    """Return the distance of the third corner of a face from the sample, unfolded into the plane of the face.

    The distances of the two ends of the side locate the unfolded sample. The result is inf if the straight line from it
    does not cross the side.
    """
    f, k = side // 3, side % 3
    at_a, at_b = distances[unfolded.faces[f, k]], distances[unfolded.faces[f, (k + 1) % 3]]
    length = unfolded.lengths[side]
    if not length > 0.0:
        return np.inf
    x = 0.5 * (length + (at_a - at_b) * (at_a + at_b) / length)
    squared = (at_a - x) * (at_a + x)
    if squared < 0.0:
        return np.inf
    y = np.sqrt(squared)
    apex_x, apex_y = unfolded.apexes[side]
    entry = x * apex_y + apex_x * y  # position along the side, multiplied by y + apex_y
    if 0.0 <= entry <= length * (y + apex_y):
        return float(np.hypot(apex_x - x, apex_y + y))
    return np.inf
