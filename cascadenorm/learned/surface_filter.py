"""Filter measured surfaces once more after the network."""

from functools import partial

import numpy as np

from cascadenorm.baselines.bilateral_normal import bilateral_normals
from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.geometry.fairing import grown
from cascadenorm.mesh import Bools, Mesh, Vectors, part_of
from cascadenorm.patches.work import normals_by_patches

SIGMA_S, SIGMA_R, SWEEPS = 0.5, 0.45, 8
"""Settings of the bilateral filter, named as in the method `bilateral-normal`."""
RIM_RINGS = 1
"""Number of rings of vertices around the boundary of a view whose faces count as its rim."""
RIM_PASSES = 3
"""Number of passes over the rim."""


def with_filtered_surfaces(mesh: Mesh, measured: Bools) -> Vectors:
    """Return the vertices after a bilateral filter of the measured surfaces.

    The network leaves some noise there, since its training data contain detail of the same size. One pass removes most
    of it. Errors of scanners are larger at the rim of a view, which is filtered RIM_PASSES times.

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
    if measured.all():
        return _filtered(mesh)
    vertices = mesh.vertices.copy()
    if measured.any():
        part, numbers = part_of(mesh, measured)
        vertices[numbers] = _filtered(part)
    return vertices


def _filtered(mesh: Mesh) -> Vectors:
    """Return the vertices, (n, 3), after a bilateral filter with more passes at the rim."""
    normals = _normals(mesh, passes=1)
    boundary = mesh.topology.boundary_vertices
    if boundary.any():
        rim = np.flatnonzero(grown(mesh, boundary, rings=RIM_RINGS)[mesh.faces].any(axis=1))
        normals[rim] = _normals(mesh, passes=RIM_PASSES)[rim]
    return recover_vertices(mesh, normals, sweeps=SWEEPS)


def _normals(mesh: Mesh, *, passes: int) -> Vectors:
    filtered = partial(bilateral_normals, sigma_s=SIGMA_S, sigma_r=SIGMA_R, iterations=passes)
    return normals_by_patches(mesh, filtered, receptive_field=passes)
