"""Volumes of regions that share walls, brought back together after the vertices have moved."""

import numpy as np
import scipy

from cascadenorm.geometry.volume import Parts, volumes
from cascadenorm.mesh import Floats, Mesh, Vectors
from cascadenorm.regions.shells import Shells

NEWTON_STEPS = 10  # converges in about three
TOLERANCE = 1e-12  # of the largest volume


def with_region_volumes(shells: Shells, mesh: Mesh, vertices: Vectors, *, weights: Floats) -> Vectors:
    """Offset the walls of regions along their normals until each closed region encloses the volume that it had.

    The offset of a wall is the difference of two numbers, those of the regions on its sides: one grows by what the
    other loses. Newton's method finds the numbers, by one linear equation for each region.

    Parameters
    ----------
    shells
        Of the walls.
    mesh
        The walls as they were, n vertices.
    vertices
        (n, 3) where their vertices are now.
    weights
        (n,) share of the offset that each vertex takes part in; those with 0 stay where they are.

    Returns
    -------
    (n, 3); `vertices` themselves where the volumes cannot be reached
    """
    before = shells.of(mesh)
    parts = _closed(before)
    if parts.total == 0:
        return vertices
    wanted = volumes(before, parts)
    size = float(np.abs(wanted).max())
    moved = vertices
    for _ in range(NEWTON_STEPS):
        now = shells.of(mesh.moved(moved))
        missing = wanted - volumes(now, parts)
        if (np.abs(missing) <= TOLERANCE * size).all():
            return moved
        slopes = _slopes(shells, now, parts, len(vertices))
        areas = np.bincount(shells.owners, np.linalg.norm(now.vertex_area_vectors, axis=1), len(vertices))
        share = np.repeat(np.divide(weights, areas, out=np.zeros(len(areas)), where=areas > 0), 3)
        gram = (slopes.multiply(share) @ slopes.T).toarray()
        offsets = np.linalg.lstsq(gram, missing, rcond=1e-10)[0]
        moved = moved + (share * (slopes.T @ offsets)).reshape(-1, 3)
    return vertices


def _closed(shells: Mesh) -> Parts:
    """Find the shells without a boundary; unlike `closed_parts`, those that touch themselves along an edge too."""
    component = shells.topology.components
    closed = np.ones(component.max() + 1, bool)
    closed[component[shells.topology.edges[shells.topology.balance != 0, 0]]] = False
    return Parts(np.where(closed, np.cumsum(closed) - 1, -1)[component], int(closed.sum()))


def _slopes(shells: Shells, now: Mesh, parts: Parts, count: int) -> "scipy.sparse.csr_array":
    """Change of the volume of each closed region by each coordinate of the walls' vertices, (parts, 3 count)."""
    inside = np.flatnonzero(parts.number >= 0)
    rows = np.repeat(parts.number[inside], 3)
    columns = (3 * shells.owners[inside, None] + np.arange(3)).ravel()
    values = now.vertex_area_vectors[inside].ravel() / 3
    return scipy.sparse.csr_array(scipy.sparse.coo_array((values, (rows, columns)), (parts.total, 3 * count)))
