"""Walls that regions share, joined from what a method has made of the shell of each region."""

import numpy as np

from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.controls.boundary import BoundaryEdges, smoothed_curve
from cascadenorm.geometry.foldovers import foldovers, without_flips
from cascadenorm.mesh import Bools, Mesh, Vectors, scatter_add, unit
from cascadenorm.regions.shells import Shells

JUNCTION_SPREAD = 100.0  # of the range weight along junction curves: none, since the steps of voxels look like corners
DIRECTION_PASSES, VERTEX_PASSES = 2, 60


def joined_walls(shells: Shells, mesh: Mesh, vertices: Vectors) -> Vectors:
    """Join the shells of regions: one place for each vertex of the walls.

    Each shell has a copy of a wall, and a method moves the two nearly alike, but not at junctions, where each shell
    bends in its own way. So a vertex takes the mean displacement of its copies and a face the mean normal of its two
    sides, and the vertices at and next to junctions move until their faces have these normals: at a junction curve to
    where its walls intersect. Then the curve is smoothed along itself, and what is next to it fits again.

    Parameters
    ----------
    shells
        k copies of vertices.
    mesh
        The walls before the method, n vertices.
    vertices
        (k, 3) where the method moved the copies.

    Returns
    -------
    (n, 3); vertices of which no copy moved stay, and joining flips no face but foldovers of the shells
    """
    # The mean displacement of the copies, and the mean normal of the sides
    count = len(mesh.vertices)
    before = shells.of(mesh)
    copies = np.maximum(np.bincount(shells.owners, minlength=count), 1)
    moves = scatter_add(shells.owners, vertices - before.vertices, count) / copies[:, None]
    joined = mesh.moved(mesh.vertices + moves)
    normals = unit(shells.wall_normals(mesh, before.moved(vertices).face_normals))

    # Fit what is at and next to junctions, smooth the curves, and fit what is next to them
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

    # Take back what flips a face next to a junction
    may_flip = np.ones(len(mesh.faces), bool)
    may_flip[near[mesh.faces].any(axis=1)] = False
    may_flip[shells.faces[foldovers(before)]] = True
    return without_flips(mesh, fitted.vertices, may_flip=may_flip)


def _fitted(mesh: Mesh, normals: Vectors, movable: Bools) -> Mesh:
    return mesh.moved(recover_vertices(mesh, normals, weighting="inverse-height", movable=movable))
