"""Limits on vertex displacement, derived from the estimated noise."""

from functools import partial

import numpy as np

from cascadenorm.detection.chords import CHORD_RINGS, NOISE_PASSES, chord_noise, chord_residuals
from cascadenorm.detection.segmentation_steps import voxel_components
from cascadenorm.geometry.foldovers import without_flips
from cascadenorm.geometry.patches.cutting import MeshPatch
from cascadenorm.geometry.patches.work import active_patching, moved_in_patches
from cascadenorm.mesh import Bools, Floats, Mesh, Vectors, row_lengths

NOISE_FACTOR = 30.0
"""Bound on the displacement of a vertex, as a multiple of the noise estimated around it. For independent noise a
factor of 4 is enough. For errors that are spatially correlated, and for edges that a reconstruction has rounded, the
estimate is only about a fifteenth of the error."""
FEWEST_COMPONENT_EDGES = 8
"""Components with fewer edges between two faces are too small for an estimate of their noise; a tetrahedron has 6."""
FACE_HEIGHTS = 4.0  # bound on the displacement of a vertex, as a multiple of the height of the tallest face around it


def safeguarded(mesh: Mesh, vertices: Vectors, measured: Bools | None = None) -> Vectors:
    """Return denoised vertices, (n, 3), whose displacements from the input mesh are limited to the bounds.

    No vertex moves farther than `displacement_bounds`, and no face flips, except to undo foldovers in the input. On the
    `measured` surfaces, (m,) faces or by default none, no edge folds either (see `without_flips`).
    """
    patching = active_patching(mesh)
    if patching is None:
        bounded = within_bounds(mesh, vertices)
    else:
        work = partial(_within_bounds_of_patch, components_without_estimate(mesh))
        bounded = moved_in_patches(mesh, patching, work, vertices, receptive_field=CHORD_RINGS + NOISE_PASSES)
    return without_flips(mesh, bounded, smooth=measured)


def _within_bounds_of_patch(unestimated: Bools, patch: MeshPatch, vertices: Vectors) -> Vectors:
    """Apply `within_bounds` to a patch, given the components of the whole mesh without an estimate of their noise."""
    return within_bounds(patch.mesh, vertices, unestimated[patch.component_numbers])


def within_bounds(mesh: Mesh, vertices: Vectors, unestimated: Bools | None = None) -> Vectors:
    """Return vertices, (n, 3), with displacements limited to `displacement_bounds`."""
    displacement = vertices - mesh.vertices
    length = row_lengths(displacement)
    bounds = displacement_bounds(mesh, unestimated)
    far = length > bounds
    moved = vertices.copy()
    moved[far] = mesh.vertices[far] + (bounds[far] / length[far])[:, None] * displacement[far]
    return moved


def displacement_bounds(mesh: Mesh, unestimated: Bools | None = None) -> Floats:
    """Return the largest displacement allowed at each vertex, (n,) in mesh units; 0 for vertices without a face.

    The bound is the smaller of NOISE_FACTOR times the noise estimated around the vertex (see `chord_noise`) and
    FACE_HEIGHTS times the height of its tallest face. Only the height counts where there is no estimate: around
    vertices without an edge between two faces, and on the `unestimated` components, (c,), which are those of
    `components_without_estimate` for a larger mesh that this one is a part of. None computes them from the mesh.
    """
    tallest = np.zeros(len(mesh.vertices))
    np.maximum.at(tallest, mesh.faces.ravel(), np.repeat(mesh.heights, 3))
    if unestimated is None:
        unestimated = components_without_estimate(mesh)
    noise = chord_noise(mesh, chord_residuals(mesh))
    noise[mesh.faces[unestimated[mesh.topology.face_components]]] = np.inf
    return np.minimum(NOISE_FACTOR * noise, FACE_HEIGHTS * tallest)


def components_without_estimate(mesh: Mesh) -> Bools:
    """Return the connected components, (c,), whose noise cannot be estimated.

    They have fewer than FEWEST_COMPONENT_EDGES edges between two faces, or consist of the faces of voxels: along voxel
    edges, the normals of both ends agree.
    """
    topology = mesh.topology
    components = topology.face_components
    edges = np.bincount(components[topology.face_pairs[:, 0]], minlength=topology.component_count)
    return (edges < FEWEST_COMPONENT_EDGES) | voxel_components(mesh)
