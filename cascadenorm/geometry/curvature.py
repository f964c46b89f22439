"""Mean curvature at vertices."""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.mesh import Mesh


def mean_curvature(mesh: Mesh) -> NDArray[np.float64]:
    """Return the mean curvature H at each vertex from Δx = -2Hn over mixed Voronoi areas (Meyer et al. 2003).

    The (n,) values are in 1 / mesh unit: 1/r on an outward-oriented sphere of radius r. They are NaN on the boundary,
    where the formula does not hold, and at vertices without area.
    """
    total = np.einsum("ij,ij->i", cotangent_laplacian(mesh).stiffness @ mesh.vertices, mesh.vertex_normals)
    areas = mixed_areas(mesh)
    curvature = np.divide(0.5 * total, areas, out=np.full(len(areas), np.nan), where=areas > 0)
    curvature[mesh.topology.boundary_vertices] = np.nan
    return np.where(np.isfinite(curvature), curvature, np.nan)


def mixed_areas(mesh: Mesh) -> NDArray[np.float64]:
    """Return the (n,) mixed area of each vertex: its Voronoi cell, with fixed shares of obtuse triangles."""
    corners = mesh.corners
    sides = np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1)  # side opposite each corner
    squares = np.square(sides).sum(axis=2)
    others = squares.sum(axis=1, keepdims=True) - squares
    cosines = others - squares  # multiplied by twice the two side lengths at the corner
    areas = mesh.areas[:, None]
    cotangents = np.divide(cosines, 4 * areas, out=np.zeros_like(cosines), where=areas > 0)
    weighted = squares * cotangents
    voronoi = (weighted.sum(axis=1, keepdims=True) - weighted) / 8
    obtuse = cosines < 0
    shares = np.where(obtuse.any(axis=1, keepdims=True), np.where(obtuse, areas / 2, areas / 4), voronoi)
    return np.asarray(np.bincount(mesh.faces.ravel(), shares.ravel(), len(mesh.vertices)), np.float64)
