"""Noise estimation from the residuals of edges against vertex normals.

A chord of a smooth surface makes the same angle with the normals at both ends; noise breaks this symmetry. For an edge
from x_i to x_j with unit vertex normals, the residual is <x_j - x_i, n_i + n_j>/2. It vanishes on spheres and cylinders
for any triangulation, and is of third order in the edge length on any smooth surface.
"""

import numpy as np

from cascadenorm.mesh import Csr, Floats, Index, Ints32, Mesh, Vectors, kernel, parallel_for
from cascadenorm.mesh.averages import averaged
from cascadenorm.mesh.vectors import Vector, add, cross, dot, length, row, subtract

CHORD_RINGS = 3  # rings around a vertex that the residuals of its edges depend on
NOISE_PASSES = 8  # averaging passes of the noise estimate: a window of about four rings
SAME_SIDE = 0.5  # cosine of 60°: faces within this angle of the mean normal of an edge are on the same side of a crease


def chord_residuals(mesh: Mesh) -> Floats:
    """Return the residual of each interior edge against the vertex normals at its ends, (i,).

    Residuals are absolute and in mesh units. At a crease, only the faces on the same side contribute to these normals.
    Faces are weighted by their area divided by the squared lengths of the two sides at the vertex, which is exact on
    spheres (Max 1999).
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
    """Return the RMS of the `chord_residuals` within about four rings of each vertex, (n,); inf if there are none."""
    topology, n = mesh.topology, len(mesh.vertices)
    sums = np.zeros((n, 2))
    _add_squares(residuals, topology.edges, topology.interior_edges, sums)
    sums = averaged(sums, topology.vertex_neighbors, NOISE_PASSES)
    return np.asarray(np.sqrt(np.divide(sums[:, 0], sums[:, 1], out=np.full(n, np.inf), where=sums[:, 1] > 0)))


@kernel
def _add_squares(residuals: Floats, edges: Ints32, interior: Ints32, sums: Floats) -> None:
    """Add the squared residual, and 1, of each interior edge to both of its ends."""
    for e in range(len(interior)):
        for end in range(2):
            v = edges[interior[e], end]
            sums[v, 0] += residuals[e] * residuals[e]
            sums[v, 1] += 1


@kernel
def _vertex_range(
    start: int, stop: int, vertices: Vectors, faces: Ints32, normals: Vectors, around: Csr, whole: Vectors
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

        # normal at each end, without faces across a crease
        for end in range(2):
            v = np.int64(ends[end])  # same type as in `_vertex_range`: kernels are compiled for each type
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
    """Sum the weighted normals of the faces around a vertex whose dot product with `direction` is at least `least`."""
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
