"""Reconstruction of shared walls from the denoised shells of the regions, and of the volumes that they enclose."""

import numpy as np
import scipy

from cascadenorm.api.regions.shells import Shells
from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.controls.boundary import BoundaryEdges, smoothed_curve
from cascadenorm.geometry.foldovers import foldovers, without_flips
from cascadenorm.geometry.volume import Parts, closed_parts, volumes
from cascadenorm.mesh import Bools, Floats, Mesh, Vectors, any_in_rows, marked, scatter_add, unit

JUNCTION_SPREAD = 100.0  # disables the range weight along junction curves, where voxel steps look like corners
JUNCTION_DIRECTION_PASSES, JUNCTION_VERTEX_PASSES = 2, 60
VOLUME_STEPS = 10  # of Newton's method, which converges in about three
VOLUME_TOLERANCE = 1e-12  # relative to the largest volume


def joined_walls(shells: Shells, mesh: Mesh, vertices: Vectors) -> Vectors:
    """Join the shells of regions, with (k, 3) denoised vertices, by finding one position for each of n wall vertices.

    A method moves the two copies of a wall almost identically, except at junctions, where each shell bends differently.
    Each vertex therefore gets the mean displacement of its copies, and each face the mean normal of its two sides. The
    vertices at and next to junctions are then fitted to these normals, which moves junction curves to the intersection
    of their walls. Finally, the curves are smoothed, and the vertices next to them are fitted again. Vertices without a
    moved copy stay in place. Joining flips no faces, except to undo foldovers in the shells.
    """
    # The mean displacement of the copies, and the mean normal of the sides
    count = len(mesh.vertices)
    before = shells.of(mesh)
    copies = np.maximum(np.bincount(shells.owners, minlength=count), 1)
    moves = scatter_add(shells.owners, vertices - before.vertices, count) / copies[:, None]
    joined = mesh.moved(mesh.vertices + moves)
    normals = unit(shells.wall_normals(mesh, before.moved(vertices).face_normals))

    # Fit the vertices at and next to junctions, smooth the curves, and refit the vertices next to them
    moved = marked(shells.owners[(vertices != before.vertices).any(axis=1)], count)
    at = marked(shells.junctions, count)
    near = at | marked(mesh.faces[at[mesh.faces].any(axis=1)], count)
    fitted = _fitted(joined, normals, near & moved)
    curves = smoothed_curve(
        fitted.vertices,
        BoundaryEdges.of(shells.junctions),
        spread=JUNCTION_SPREAD,
        passes=JUNCTION_DIRECTION_PASSES,
        vertex_passes=JUNCTION_VERTEX_PASSES,
    )
    smooth = fitted.moved(np.where((at & moved)[:, None], curves, fitted.vertices))
    fitted = _fitted(smooth, normals, near & moved & ~at)

    # Reduce displacements that flip a face next to a junction
    may_flip = ~any_in_rows(near[mesh.faces])
    may_flip[shells.faces[foldovers(before)]] = True
    return without_flips(mesh, fitted.vertices, may_flip=may_flip)


def _fitted(mesh: Mesh, normals: Vectors, movable: Bools) -> Mesh:
    return mesh.moved(recover_vertices(mesh, normals, weighting="cotangent", movable=movable))


def with_region_volumes(shells: Shells, mesh: Mesh, vertices: Vectors, *, weights: Floats) -> Vectors:
    """Restore the volume of each closed region by offsetting the (n, 3) vertices of walls along their normals.

    The offset has a weight, (n,), at each vertex; vertices with weight 0 stay in place. Each region has one unknown.
    The offset of a wall is the difference between the unknowns of its two regions, so one region gains the volume that
    the other loses. Newton's method solves for the unknowns, with one linear equation per region. `mesh` has the
    original walls. Returns `vertices` itself if the volumes cannot be restored.
    """
    before = shells.of(mesh)
    parts = closed_parts(before, may_touch=True)
    if parts.total == 0:
        return vertices
    wanted = volumes(before, parts)
    size = float(np.abs(wanted).max())
    moved = vertices
    for _ in range(VOLUME_STEPS):
        now = shells.of(mesh.moved(moved))
        missing = wanted - volumes(now, parts)
        if (np.abs(missing) <= VOLUME_TOLERANCE * size).all():
            return moved
        slopes = _slopes(shells, now, parts, len(vertices))
        areas = np.bincount(shells.owners, np.linalg.norm(now.vertex_area_vectors, axis=1), len(vertices))
        share = np.repeat(np.divide(weights, areas, out=np.zeros(len(areas)), where=areas > 0), 3)
        gram = (slopes.multiply(share) @ slopes.T).toarray()
        offsets = np.linalg.lstsq(gram, missing, rcond=1e-10)[0]
        moved = moved + (share * (slopes.T @ offsets)).reshape(-1, 3)
    return vertices


def _slopes(shells: Shells, now: Mesh, parts: Parts, count: int) -> "scipy.sparse.csr_array":
    """Return the derivatives of the region volumes with respect to the wall vertices, (parts, 3 count)."""
    inside = np.flatnonzero(parts.number >= 0)
    rows = np.repeat(parts.number[inside], 3)
    columns = (3 * shells.owners[inside, None] + np.arange(3)).ravel()
    values = now.vertex_area_vectors[inside].ravel() / 3
    return scipy.sparse.csr_array(scipy.sparse.coo_array((values, (rows, columns)), (parts.total, 3 * count)))
