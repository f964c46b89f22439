"""Mean curvature at vertices."""

import numpy as np

from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.mesh import Floats, Ints32, Mesh, Vectors, kernel, parallel_for, scatter_add
from cascadenorm.mesh.vectors import row, squared_distance


def mean_curvature(mesh: Mesh) -> Floats:
    """Return the mean curvature H at each vertex from Δx = -2Hn over mixed Voronoi areas (Meyer et al. 2003).

    The (n,) values are in 1 / mesh unit: 1/r on an outward-oriented sphere of radius r. They are NaN on the boundary,
    where the formula does not hold, and at vertices without area.
    """
    gradients = cotangent_laplacian(mesh).stiffness @ mesh.vertices  # Σ_j (cot α + cot β)/2 (x_i - x_j)
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
