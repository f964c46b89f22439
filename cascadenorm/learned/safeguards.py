"""Limits on vertex displacement: a model moves no vertex farther than the noise around it explains."""

from functools import partial
from typing import NamedTuple

import numpy as np

from cascadenorm.detection.chords import CHORD_RINGS, NOISE_PASSES, chord_noise, chord_residuals
from cascadenorm.detection.segmentation_steps import has_voxel_faces
from cascadenorm.geometry.foldovers import without_flips, without_folds
from cascadenorm.mesh import Bools, Floats, Mesh, Vectors, row_lengths
from cascadenorm.patches.cutting import MeshPatch
from cascadenorm.patches.work import moved_in_patches, patching_of

NOISES = 30.0
"""Times the estimated noise around it that a vertex may move. Of independent noise 4 times are enough; of an error that
is alike over several edges, or of an edge that a reconstruction has rounded, the estimate sees a fifteenth."""
FEWEST_COMPONENT_EDGES = 8
"""Edges with two faces of a component, of which fewer tell nothing of its noise; a tetrahedron has 6."""
FACE_HEIGHTS = 4.0
"""Times the height of the tallest face around it that a vertex may move."""


def safeguarded(mesh: Mesh, vertices: Vectors, measured: Bools | None = None) -> Vectors:
    """Return vertices with displacements taken back as far as the bounds ask for.

    No vertex moves farther than `displacement_bounds`, and no face flips, except to undo foldovers in the input (see
    `without_flips`). On measured surfaces no edge folds either (see `without_folds`).

    Parameters
    ----------
    mesh
        The input, n vertices.
    vertices
        (n, 3), where a model wants them.
    measured
        (m,) faces of measured surfaces; None for none.

    Returns
    -------
    (n, 3)
    """
    patching = patching_of(mesh)
    if patching is None:
        bounded = within_bounds(mesh, vertices)
    else:
        work = partial(_within_bounds_of_patch, what_is_bounded(mesh))
        bounded = moved_in_patches(mesh, patching, work, vertices, reach=CHORD_RINGS + NOISE_PASSES, components=True)
    return without_flips(mesh, bounded) if measured is None else without_folds(mesh, bounded, measured)


def _within_bounds_of_patch(bounded: "Bounded", patch: MeshPatch, vertices: Vectors) -> Vectors:
    """Do what `within_bounds` does on a patch, with the facts about the whole mesh."""
    here = Bounded(bounded.untold[patch.component_numbers], bounded.voxel_faces)
    return within_bounds(patch.mesh, vertices, here)


def within_bounds(mesh: Mesh, vertices: Vectors, bounded: "Bounded | None" = None) -> Vectors:
    """Return vertices, (n, 3), of which none has moved farther than `displacement_bounds`."""
    displacement = vertices - mesh.vertices
    length = row_lengths(displacement)
    bounds = displacement_bounds(mesh, bounded)
    far = length > bounds
    moved = vertices.copy()
    moved[far] = mesh.vertices[far] + (bounds[far] / length[far])[:, None] * displacement[far]
    return moved


class Bounded(NamedTuple):
    """What bounds depend on beyond what is around a vertex.

    Parameters
    ----------
    untold
        (c,) connected components with too few edges to estimate their noise.
    voxel_faces
        Whether the mesh consists of the faces of voxels.
    """

    untold: Bools
    voxel_faces: bool


def displacement_bounds(mesh: Mesh, bounded: Bounded | None = None) -> Floats:
    """Return how far each vertex may move.

    The bound is the least of NOISES times the noise estimated around the vertex (see `chord_noise`) and FACE_HEIGHTS
    times the height of its tallest face. On components with fewer than FEWEST_COMPONENT_EDGES edges between two faces,
    around vertices without such an edge, and on the faces of voxels, there is no estimate, and the height alone counts.

    Parameters
    ----------
    mesh
        Mesh with n vertices.
    bounded
        Facts about the mesh that this one is a part of. Computed from `mesh` if None.

    Returns
    -------
    (n,) lengths in mesh units; 0 for vertices without a face.
    """
    tallest = np.zeros(len(mesh.vertices))
    np.maximum.at(tallest, mesh.faces.ravel(), np.repeat(mesh.heights, 3))
    bounded = bounded or what_is_bounded(mesh)
    noise = chord_noise(mesh, chord_residuals(mesh))
    noise[mesh.faces[bounded.untold[mesh.topology.face_components]]] = np.inf
    if bounded.voxel_faces:  # along their edges the normals of both ends agree
        noise[:] = np.inf
    return np.minimum(NOISES * noise, FACE_HEIGHTS * tallest)


def what_is_bounded(mesh: Mesh) -> Bounded:
    """Return the facts about a whole mesh that the bounds depend on."""
    topology = mesh.topology
    components = topology.face_components
    edges = np.bincount(components[topology.face_pairs[:, 0]], minlength=int(components.max()) + 1)
    return Bounded(edges < FEWEST_COMPONENT_EDGES, has_voxel_faces(mesh))
