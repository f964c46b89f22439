"""Let vertices on the flat sides of a volume mesh slide along them.

Vertices slide within a side, or along the edge where two sides meet. A side, such as a face of the outer box, is a
plane with all vertices on one side of it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from cascadenorm.geometry.foldovers import foldovers, without_flips
from cascadenorm.mesh import Floats, Ints, Mesh, Vectors, connected_components, marked, unit

PLANE_TOLERANCE = 1e-6  # largest distance of a vertex from its plane, in diagonals of the bounding box
MIN_COVERED_FRACTION = 0.5  # smallest share of the outline along its normal that the vertices on a plane span
PARALLEL_TOLERANCE = 1e-8  # limit for eigenvalues of Σ n nᵀ: normals that differ by less than 0.01° count as parallel
MIN_FACET_AREA = 1e-4  # of the area of the convex hull; smaller facets are not sides


class Sliding(NamedTuple):
    """The vertices that slide, and their remaining degrees of freedom."""

    vertices: Ints  # (k,) vertex indices, ascending
    projections: Floats  # (k, 3, 3) projections onto the free directions: a plane, a line, or nothing

    def constrained(self, displacement: Vectors) -> Vectors:
        """Return the displacement, (n, 3), without the part that leaves the planes."""
        kept = displacement.copy()
        kept[self.vertices] = np.einsum("kij,kj->ki", self.projections, displacement[self.vertices])
        return kept

    def slid(self, step: Callable[[Mesh], Vectors], mesh: Mesh) -> Vectors:
        """Return the vertices after a step and sliding, without displacements that would flip a face."""
        slid = mesh.vertices + self.constrained(step(mesh) - mesh.vertices)
        slides = marked(self.vertices, len(slid))
        may_flip = foldovers(mesh) | ~slides[mesh.faces].any(axis=1)
        return without_flips(mesh, slid, may_flip=may_flip)


def sliding(mesh: Mesh) -> Sliding:
    """Find the vertices on the flat sides of a mesh, within 1e-6 of its diagonal from a plane of `outer_planes`."""
    normals, offsets = outer_planes(mesh)
    used = np.unique(mesh.faces).astype(np.int64)
    on = np.abs(mesh.vertices[used] @ normals.T - offsets) <= PLANE_TOLERANCE * mesh.diagonal
    on, vertices = on[on.any(axis=1)], used[on.any(axis=1)]

    # The free directions are the null space of Σ n nᵀ
    values, axes = np.linalg.eigh(np.einsum("kp,pi,pj->kij", on.astype(float), normals, normals))
    free = values <= PARALLEL_TOLERANCE
    return Sliding(vertices, np.einsum("kia,ka,kja->kij", axes, free.astype(float), axes))


def outer_planes(mesh: Mesh) -> tuple[Vectors, Floats]:
    """Return the planes <n, x> = d of the flat sides of a mesh, as (p, 3) unit normals n and (p,) offsets d.

    They are the planes of those facets of the convex hull that cover at least half of the outline of the hull along
    their normal. All sides of a box and the cut through a ball qualify, but not the flat spots of a voxelized ball.
    """
    points = mesh.vertices[np.unique(mesh.faces)]
    try:
        hull = scipy.spatial.ConvexHull(points)
    except (scipy.spatial.QhullError, ValueError):  # all vertices are coplanar
        return np.zeros((0, 3)), np.zeros(0)
    normals, offsets = hull.equations[:, :3], -hull.equations[:, 3]
    corners = points[hull.simplices]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2

    # Merge neighboring coplanar triangles of the hull: the vertices of each lie on the plane of the other
    count = len(normals)
    first, second = np.repeat(np.arange(count), 3), hull.neighbors.ravel()
    away = np.abs(np.einsum("eci,ei->ec", corners[first], normals[second]) - offsets[second, None]).max(axis=1)
    joined = (away <= PLANE_TOLERANCE * mesh.diagonal) & (np.einsum("ei,ei->e", normals[first], normals[second]) > 0)
    facet = connected_components(np.stack([first[joined], second[joined]], axis=1), count)
    size = np.bincount(facet, areas)
    normal = unit(np.stack([np.bincount(facet, areas * axis) for axis in normals.T], axis=1))
    offset = np.bincount(facet, areas * offsets) / np.maximum(size, np.finfo(float).tiny)

    # The outline along a direction is half of the projected area of the hull
    large = size > MIN_FACET_AREA * areas.sum()
    outline = np.abs(normal[large] @ normals.T) @ areas / 2
    sides = size[large] >= MIN_COVERED_FRACTION * outline
    return normal[large][sides], offset[large][sides]
