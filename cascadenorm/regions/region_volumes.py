"""Joint restoration of the volumes of regions that share walls."""

import numpy as np
import scipy

from cascadenorm.geometry.volume import Parts, volumes
from cascadenorm.mesh import Floats, Mesh, Vectors
from cascadenorm.regions.shells import Shells

NEWTON_STEPS = 10  # converges in about three
TOLERANCE = 1e-12  # relative to the largest volume


def with_region_volumes(shells: Shells, mesh: Mesh, vertices: Vectors, *, weights: Floats) -> Vectors:
    """Restore the volume of each closed region by offsetting the (n, 3) vertices of walls along their normals.

    The offset has a weight, (n,), at each vertex; vertices with weight 0 stay in place. Each region has one unknown.
    The offset of a wall is the difference between the unknowns of its two regions, so one region gains the volume that
    the other loses. Newton's method solves for the unknowns, with one linear equation per region. `mesh` has the
    original walls. Returns `vertices` itself if the volumes cannot be restored.
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
    """Find the shells without a boundary, including those that touch themselves along an edge."""
    component = shells.topology.components
    closed = np.ones(component.max() + 1, bool)
    closed[component[shells.topology.edges[shells.topology.balance != 0, 0]]] = False
    return Parts(np.where(closed, np.cumsum(closed) - 1, -1)[component], int(closed.sum()))


def _slopes(shells: Shells, now: Mesh, parts: Parts, count: int) -> "scipy.sparse.csr_array":
    """Return the derivatives of the region volumes with respect to the wall vertices, (parts, 3 count)."""
    inside = np.flatnonzero(parts.number >= 0)
    rows = np.repeat(parts.number[inside], 3)
    columns = (3 * shells.owners[inside, None] + np.arange(3)).ravel()
    values = now.vertex_area_vectors[inside].ravel() / 3
    return scipy.sparse.csr_array(scipy.sparse.coo_array((values, (rows, columns)), (parts.total, 3 * count)))
