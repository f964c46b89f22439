"""Mean curvature at vertices."""

import numpy as np

from cascadenorm.geometry.laplacians import face_cotangents
from cascadenorm.mesh import Csr, Floats, Ints32, Mesh, Vectors, kernel, parallel_for, scatter_add
from cascadenorm.mesh.vectors import add, row, scaled, squared_distance, subtract


def mean_curvature(mesh: Mesh) -> Floats:
    """Return the mean curvature H at each vertex from Δx = -2Hn over mixed Voronoi areas (Meyer et al. 2003).

    The (n,) values are in 1 / mesh unit: 1/r on an outward-oriented sphere of radius r. They are NaN on the boundary,
    where the formula does not hold, and at vertices without area.
    """
    cotangents, _ = face_cotangents(mesh)
    # the product of the cotangent stiffness and the vertices, Σ_j (cot α + cot β)/2 (x_i - x_j)
    gradients = np.empty_like(mesh.vertices)
    around = mesh.topology.vertex_faces
    parallel_for(len(gradients), _gradient_range, mesh.vertices, mesh.faces, around, cotangents, gradients)
    total, areas = np.einsum("ij,ij->i", gradients, mesh.vertex_normals), mixed_areas(mesh)
    curvature = np.divide(0.5 * total, areas, out=np.full(len(areas), np.nan), where=areas > 0)
    curvature[mesh.topology.boundary_vertices] = np.nan
    return np.where(np.isfinite(curvature), curvature, np.nan)


def mixed_areas(mesh: Mesh) -> Floats:
    """Return the (n,) mixed area of each vertex: its Voronoi cell, with fixed shares of obtuse triangles."""
    shares = np.empty(mesh.faces.shape)
    parallel_for(len(shares), _share_range, mesh.vertices, mesh.faces, mesh.areas, shares)
    return scatter_add(mesh.faces.ravel(), shares.ravel(), len(mesh.vertices))


@kernel
def _gradient_range(
    start: int, stop: int, vertices: Vectors, faces: Ints32, around: Csr, cotangents: Floats, out: Vectors
) -> None:
    for i in range(start, stop):
        total = (0.0, 0.0, 0.0)
        for k in range(around.indptr[i], around.indptr[i + 1]):
            f = around.indices[k]
            if k > around.indptr[i] and around.indices[k - 1] == f:
                continue  # a face that repeats the vertex
            for side in range(3):
                a, b = faces[f, side], faces[f, (side + 1) % 3]
                if i in (a, b):
                    arm = subtract(row(vertices, i), row(vertices, b if a == i else a))
                    total = add(total, scaled(0.5 * cotangents[f, side], arm))
        out[i, 0], out[i, 1], out[i, 2] = total


@kernel
def _share_range(start: int, stop: int, vertices: Vectors, faces: Ints32, areas: Floats, out: Floats) -> None:
    """Write the share of each corner in the area of its face."""
    for f in range(start, stop):
        a, b, c = row(vertices, faces[f, 0]), row(vertices, faces[f, 1]), row(vertices, faces[f, 2])
        squares = squared_distance(b, c), squared_distance(c, a), squared_distance(a, b)  # of the opposite sides
        total = squares[0] + squares[1] + squares[2]
        obtuse = 2 * max(squares) > total
        for k in range(3):
            one, other = squares[(k + 1) % 3], squares[(k + 2) % 3]
            if obtuse:
                out[f, k] = areas[f] / 2 if 2 * squares[k] > total else areas[f] / 4
            elif areas[f] > 0:  # cot = (total - 2 square) / 4 area
                out[f, k] = (one * (total - 2 * one) + other * (total - 2 * other)) / (32 * areas[f])
            else:
                out[f, k] = 0.0
