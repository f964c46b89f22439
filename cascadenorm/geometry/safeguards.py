"""How far vertices may go, wherever a model wants them: on exact surfaces nowhere, else as far as noise explains."""

from typing import NamedTuple

import numpy as np

from cascadenorm.geometry.chords import Chords, chords, local_noise
from cascadenorm.geometry.exact_surfaces import computed_components
from cascadenorm.geometry.foldovers import without_flips
from cascadenorm.geometry.parts import InMemory, Surface
from cascadenorm.geometry.segmentation_steps import has_voxel_faces
from cascadenorm.mesh import Bools, Floats, Mesh, Vectors, row_lengths

NOISES = 30.0
"""Times the estimated noise around it that a vertex may move. Of independent noise 4 times are enough; of an error that
is alike over several edges, or of an edge that a reconstruction has rounded, the estimate sees a fifteenth."""
FEWEST = 8
"""Edges with two faces of a component, of which fewer tell nothing of its noise; a tetrahedron has 6."""
HEIGHTS = 4.0
"""Times the height of the tallest face around it that a vertex may move."""


def safeguarded(mesh: Mesh, vertices: Vectors) -> Vectors:
    """Return vertices with displacements taken back as far as the bounds ask for.

    The vertices of exact components stay where they are (see `exact_vertices`), no other vertex moves farther than
    `displacement_bounds`, and no face flips but foldovers (see `without_flips`).

    Parameters
    ----------
    mesh : the input, n vertices
    vertices : (n, 3), where a model wants them

    Returns
    -------
    (n, 3)
    """
    return without_flips(mesh, within_bounds(mesh, vertices))


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
    exact : (c,) connected components that do not move
    untold : (c,) those whose noise is not told
    voxel_faces : whether the mesh consists of these
    """

    exact: Bools
    untold: Bools
    voxel_faces: bool


def displacement_bounds(mesh: Mesh, bounded: Bounded | None = None) -> Floats:
    """How far each vertex may move, (n,), in the unit of the mesh.

    0 on exact components and for vertices without a face, else the least of NOISES times the noise estimated around the
    vertex (see `local_noise`) and HEIGHTS times the height of its tallest face. On components with fewer than FEWEST
    edges between two faces, and on the faces of voxels, there is no estimate, and the height alone counts.

    Parameters
    ----------
    bounded : what the mesh is a part of; None: it is no part
    """
    tallest = np.zeros(len(mesh.vertices))
    np.maximum.at(tallest, mesh.faces.ravel(), np.repeat(mesh.heights, 3))
    measured, part = chords(mesh), mesh.topology.face_components
    bounded = bounded or what_is_bounded(InMemory(mesh), measured)
    noise = local_noise(mesh, measured.residuals)
    noise[mesh.faces[bounded.untold[part]]] = np.inf
    if bounded.voxel_faces:  # along their edges the normals of both ends agree
        noise[:] = np.inf
    bounds = np.minimum(NOISES * noise, HEIGHTS * tallest)
    bounds[mesh.faces[bounded.exact[part]]] = 0.0
    return bounds


def what_is_bounded(surface: Surface, measured: Chords | None = None) -> Bounded:
    """Return what the bounds depend on.

    Parameters
    ----------
    measured : the chords, where the surface is a mesh in memory and they are known
    """
    components = computed_components(surface, measured)
    return Bounded(components.computed, components.edges < FEWEST, has_voxel_faces(surface))
