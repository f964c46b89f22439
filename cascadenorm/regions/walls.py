"""Reconstruction of shared walls from the denoised shells of the regions."""

import numpy as np

from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.controls.boundary import BoundaryEdges, smoothed_curve
from cascadenorm.geometry.foldovers import foldovers, without_flips
from cascadenorm.mesh import Bools, Mesh, Vectors, scatter_add, unit
from cascadenorm.regions.shells import Shells

JUNCTION_SPREAD = 100.0  # disables the range weight along junction curves, where voxel steps look like corners
DIRECTION_PASSES, VERTEX_PASSES = 2, 60


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
    moved = np.zeros(count, bool)
    moved[shells.owners[(vertices != before.vertices).any(axis=1)]] = True
    at = np.zeros(count, bool)
    at[shells.junctions] = True
    near = at.copy()
    near[mesh.faces[at[mesh.faces].any(axis=1)]] = True
    fitted = _fitted(joined, normals, near & moved)
    curves = smoothed_curve(
        fitted.vertices,
        BoundaryEdges.of(shells.junctions),
        spread=JUNCTION_SPREAD,
        passes=DIRECTION_PASSES,
        vertex_passes=VERTEX_PASSES,
    )
    smooth = fitted.moved(np.where((at & moved)[:, None], curves, fitted.vertices))
    fitted = _fitted(smooth, normals, near & moved & ~at)

    # Reduce displacements that flip a face next to a junction
    may_flip = np.ones(len(mesh.faces), bool)
    may_flip[near[mesh.faces].any(axis=1)] = False
    may_flip[shells.faces[foldovers(before)]] = True
    return without_flips(mesh, fitted.vertices, may_flip=may_flip)


def _fitted(mesh: Mesh, normals: Vectors, movable: Bools) -> Mesh:
    return mesh.moved(recover_vertices(mesh, normals, weighting="inverse-height", movable=movable))
