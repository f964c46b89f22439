"""Meshes whose vertices coincide, as those of regions that share walls, joined into one."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from cascadenorm.mesh import Ints, Mesh, connected_components

COINCIDENT = 2.0**-20
"""Of the largest coordinate: single precision and six decimal digits come within it."""
LEAST_APART = 0.01
"""Mean edge lengths: vertices that are farther apart than this are two, however large the coordinates."""


class Joined(NamedTuple):
    """Meshes joined where their vertices coincide.

    Parameters
    ----------
    mesh
        The vertices of all, those that coincide once, at the place of the first; and the faces of all, in order.
    vertices
        (k,) the vertex of `mesh` that each vertex of each mesh is, one mesh after the other.
    """

    mesh: Mesh
    vertices: Ints


def coincident(meshes: Sequence[Mesh]) -> tuple[Ints, Ints]:
    """Find the vertices of different meshes that coincide within rounding.

    Vertices of one mesh are not joined with one another, unless both coincide with one of another mesh.

    Returns
    -------
    (k,) for each vertex of each mesh, one mesh after the other, the first that it coincides with; and for each mesh the
    number of its group, those of meshes that vertices connect
    """
    # Pairs of used vertices of different meshes within the tolerance
    counts = [len(mesh.vertices) for mesh in meshes]
    positions = np.concatenate([mesh.vertices for mesh in meshes])
    owner = np.repeat(np.arange(len(meshes)), counts)
    used = np.flatnonzero(np.concatenate([mesh.topology.used_vertices for mesh in meshes]))
    size = float(np.abs(positions[used]).max())
    tolerance = min(COINCIDENT * size, LEAST_APART * min(mesh.mean_edge_length for mesh in meshes))
    pairs = used[scipy.spatial.cKDTree(positions[used]).query_pairs(tolerance, output_type="ndarray")]
    pairs = pairs[owner[pairs[:, 0]] != owner[pairs[:, 1]]]

    # The first vertex of those that pairs connect, and the meshes that they connect
    part = connected_components(pairs, len(positions))
    _, first, which = np.unique(part, return_index=True, return_inverse=True)
    return first[which.reshape(-1)].astype(np.int64), connected_components(owner[pairs], len(meshes)).astype(np.int64)


def joined_meshes(meshes: Sequence[Mesh], first: Ints) -> Joined:
    """Join meshes into one.

    Parameters
    ----------
    first
        (k,) for each vertex of these meshes the first that it coincides with, as `coincident` returns it.
    """
    kept = first == np.arange(len(first))
    vertices = (np.cumsum(kept) - 1)[first]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [vertices[start + mesh.faces] for start, mesh in zip(starts, meshes, strict=False)]
    positions = np.concatenate([mesh.vertices for mesh in meshes])
    return Joined(Mesh(positions[kept], np.concatenate(faces)), vertices)
