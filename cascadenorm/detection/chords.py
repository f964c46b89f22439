"""Edges against the normals at their ends: a chord of a smooth surface makes the same angle with both, noise does not.

For an edge from x_i to x_j and unit vertex normals, the residual <x_j - x_i, n_i + n_j>/2 is error: it vanishes on
spheres and cylinders, however they are triangulated, and is of third order in the length of the edge on any smooth
surface.
"""

import numpy as np

from cascadenorm.mesh import Csr, Floats, Index, Ints32, Mesh, Vectors, kernel, parallel_for
from cascadenorm.mesh.averages import averaged
from cascadenorm.mesh.vectors import Vector, add, cross, dot, length, row, subtract

CHORD_RINGS = 3  # edges around a vertex that the residuals of its edges depend on
NOISE_PASSES = 8  # averages over neighbours that a noise estimate is taken from: about four rings
SAME_SIDE = 0.5
"""Cosine, 60°, of the angle to the mean normal of an edge up to which faces at its ends are on its side of a crease."""


def chord_residuals(mesh: Mesh) -> Floats:
    """Measure each edge that has two faces against the normals at its ends, those of this side at a crease.

    A normal is the mean of faces by their area over the squared lengths of the two sides that meet in the vertex, which
    is exact on spheres (Max 1999).

    Returns
    -------
    (i,) absolute residuals in mesh units, in the order of `Topology.interior_edges`.
    """
    topology, n = mesh.topology, len(mesh.vertices)
    around = topology.vertex_faces
    whole = np.empty((n, 3))
    parallel_for(n, _vertex_range, mesh.vertices, mesh.faces, mesh.face_normals, around, whole)
    interior = topology.interior_edges
    residuals = np.empty(len(interior))
    parallel_for(
        len(interior), _chord_range, mesh.vertices, mesh.faces, mesh.face_normals, topology.edges, interior,
        topology.face_pairs, around, whole, residuals,
    )  # fmt: skip
    return residuals


def chord_noise(mesh: Mesh, residuals: Floats) -> Floats:
    """Estimate the noise around each vertex: the RMS of the residuals of the chords within about four rings.

    Returns
    -------
    (n,) in mesh units; infinite where no edge with two faces is near
    """
    topology, n = mesh.topology, len(mesh.vertices)
    sums = np.zeros((n, 2))
    _add_squares(residuals, topology.edges, topology.interior_edges, sums)
    sums = averaged(sums, topology.vertex_neighbors, NOISE_PASSES)
    return np.asarray(np.sqrt(np.divide(sums[:, 0], sums[:, 1], out=np.full(n, np.inf), where=sums[:, 1] > 0)))


def rises(mesh: Mesh, pairs: Ints32) -> Floats:
    """Return (k,) how far the centroids of the two faces of each pair rise over each other's planes, together.

    It is negative where they meet in a convex edge.
    """
    out = np.empty(len(pairs))
    parallel_for(len(out), _rise_range, mesh.centroids, mesh.face_normals, pairs, out)
    return out


@kernel
def _rise(centroids: Vectors, normals: Vectors, f: Index, g: Index) -> float:
    """See `rises`."""
    across, turn = subtract(row(centroids, g), row(centroids, f)), subtract(row(normals, f), row(normals, g))
    rise: float = dot(across, turn)
    return rise


@kernel
def _rise_range(start: int, stop: int, centroids: Vectors, normals: Vectors, pairs: Ints32, out: Floats) -> None:
    for i in range(start, stop):
        out[i] = _rise(centroids, normals, pairs[i, 0], pairs[i, 1])


@kernel
def _add_squares(residuals: Floats, edges: Ints32, interior: Ints32, sums: Floats) -> None:
    """Add to both ends of each edge with two faces the square of its residual, and 1."""
    for e in range(len(interior)):
        for end in range(2):
            v = edges[interior[e], end]
            sums[v, 0] += residuals[e] * residuals[e]
            sums[v, 1] += 1


@kernel
def _vertex_range(
    start: int,
    stop: int,
    vertices: Vectors,
    faces: Ints32,
    normals: Vectors,
    around: Csr,
    whole: Vectors,
) -> None:
    """Sum the weighted normals of all faces around each vertex."""
    for i in range(start, stop):
        mine = around.indices[around.indptr[i] : around.indptr[i + 1]]
        normal = _normal(vertices, faces, normals, mine, i, (0.0, 0.0, 0.0), 0.0)
        whole[i, 0], whole[i, 1], whole[i, 2] = normal


@kernel
def _chord_range(
    start: int,
    stop: int,
    vertices: Vectors,
    faces: Ints32,
    normals: Vectors,
    edges: Ints32,
    interior: Ints32,
    pairs: Ints32,
    around: Csr,
    whole: Vectors,
    residuals: Floats,
) -> None:
    rises = np.empty(2)
    for i in range(start, stop):
        mean = add(row(normals, pairs[i, 0]), row(normals, pairs[i, 1]))
        least = SAME_SIDE * length(mean)
        ends = edges[interior[i]]
        step = subtract(row(vertices, ends[1]), row(vertices, ends[0]))

        # the normal at either end, of all faces around it but those beyond a crease
        for end in range(2):
            v = np.int64(ends[end])  # as in `_vertex_range`: a kernel is compiled for each type
            first, last, beyond = around.indptr[v], around.indptr[v + 1], 0
            for k in range(first, last):
                beyond += dot(row(normals, around.indices[k]), mean) < least
            normal = row(whole, v)
            if beyond > 0:
                normal = _normal(vertices, faces, normals, around.indices[first:last], v, mean, least)
            size = length(normal)
            rises[end] = dot(step, normal) / size if size > 0 else 0.0

        residuals[i] = 0.5 * abs(rises[0] + rises[1])


@kernel
def _normal(
    vertices: Vectors, faces: Ints32, normals: Vectors, mine: Ints32, v: Index, direction: Vector, least: float
) -> Vector:
    """Sum of the weighted normals of the faces around a vertex, of those that go along a direction by so much."""
    x = y = z = 0.0
    for f in mine:
        n = row(normals, f)
        if dot(n, direction) < least:
            continue
        a, b, c = faces[f]
        while a != v:
            a, b, c = b, c, a
        one, other = subtract(row(vertices, b), row(vertices, a)), subtract(row(vertices, c), row(vertices, a))
        squares = dot(one, one) * dot(other, other)
        weight = length(cross(one, other)) / squares if squares > 0 else 0.0
        x, y, z = x + weight * n[0], y + weight * n[1], z + weight * n[2]
    return x, y, z
