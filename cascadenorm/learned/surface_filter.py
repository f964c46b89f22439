"""Filter measured surfaces bilaterally after the cascade, with more passes and fitted quadrics near boundaries."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from cascadenorm.baselines.bilateral_normal import bilateral_normals
from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.geometry.fairing import grown
from cascadenorm.geometry.patches.work import normals_by_patches
from cascadenorm.geometry.quadrics import quadric_normals
from cascadenorm.mesh import Bools, Mesh, Vectors, part_of, unit, with_part_moved

SIGMA_S, SIGMA_R, SWEEPS = 0.5, 0.45, 8
"""Settings of the bilateral filter, named as in the method `bilateral-normal`."""
BOUNDARY_RINGS = 1
"""Number of rings of vertices around the boundary whose faces count as near it, which gives two rings of faces."""
BOUNDARY_PASSES = 3
"""Number of passes over the faces near the boundary."""
QUADRIC_SHARES = 0.7, 0.3
"""Shares of the normals of fitted quadrics: at faces on the boundary, and at the faces next to them."""


def with_filtered_surfaces(mesh: Mesh, measured: Bools) -> Vectors:
    """Return the vertices after a bilateral filter of the measured surfaces.

    The network leaves some noise there, since its training data contain detail of the same size. One pass removes most
    of it. Errors of scanners are larger near the boundary of a view, where the filter runs BOUNDARY_PASSES times and
    normals of fitted quadrics take part. A filter alone would flatten the surface, which often curves away there.

    Parameters
    ----------
    mesh
        Mesh with n vertices and m faces.
    measured
        (m,) faces of measured surfaces, whole components.

    Returns
    -------
    (n, 3) vertices.
    """
    return with_part_moved(mesh, measured, _filtered)


def _filtered(mesh: Mesh) -> Vectors:
    """Return the vertices, (n, 3), after a bilateral filter that differs near the boundary."""
    normals = _normals(mesh, passes=1)
    boundary = mesh.topology.boundary_vertices
    if boundary.any():
        at, near, around = (
            np.flatnonzero(grown(mesh, boundary, rings=rings)[mesh.faces].any(axis=1))
            for rings in (0, BOUNDARY_RINGS, BOUNDARY_RINGS + BOUNDARY_PASSES)
        )
        part = part_of(mesh, around)[0].with_facts(mean_edge_length=mesh.mean_edge_length)
        normals[near] = _normals(part, passes=BOUNDARY_PASSES)[np.searchsorted(around, near)]
        normals = _with_quadrics(mesh, normals, at, np.setdiff1d(near, at))
    return recover_vertices(mesh, normals, sweeps=SWEEPS)


def _with_quadrics(mesh: Mesh, normals: Vectors, at: NDArray[np.intp], beside: NDArray[np.intp]) -> Vectors:
    """Return (m, 3) normals averaged with those of quadrics, at faces on the boundary and at those beside them."""
    averaged = normals.copy()
    for share, faces in zip(QUADRIC_SHARES, (at, beside), strict=True):
        averaged[faces] = unit((1 - share) * normals[faces] + share * quadric_normals(mesh, normals, faces))
    return averaged


def _normals(mesh: Mesh, *, passes: int) -> Vectors:
    filtered = partial(bilateral_normals, sigma_s=SIGMA_S, sigma_r=SIGMA_R, iterations=passes)
    return normals_by_patches(mesh, filtered, receptive_field=passes)
