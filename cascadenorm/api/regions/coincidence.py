"""Joining of meshes with coincident vertices, such as regions with shared walls."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy

from cascadenorm.mesh import Ints, Mesh, connected_components

COINCIDENCE_TOLERANCE = 2.0**-20  # share of the largest coordinate, more than single precision and six digits round
MAX_TOLERANCE_EDGES = 0.01  # upper limit of the tolerance in mean edge lengths, for meshes with large coordinates


class Joined(NamedTuple):
    """Meshes joined at coincident vertices."""

    mesh: Mesh  # the faces of all meshes in order. Coincident vertices occur once, at the position of the first
    vertices: Ints  # (k,) vertex of `mesh` for each vertex of the original meshes, one mesh after the other


def coincident_vertices(meshes: Sequence[Mesh]) -> tuple[Ints, Ints]:
    """Find the vertices of different meshes that coincide within rounding.

    Vertices of the same mesh are joined only if both coincide with a vertex of another mesh. Returns the (k,) first
    coincident vertex of each vertex, one mesh after the other; and the group of each mesh, where meshes with coincident
    vertices belong to the same group.
    """
    # Pairs of used vertices of different meshes within the tolerance
    counts = [len(mesh.vertices) for mesh in meshes]
    positions = np.concatenate([mesh.vertices for mesh in meshes])
    owner = np.repeat(np.arange(len(meshes)), counts)
    used = np.flatnonzero(np.concatenate([mesh.topology.used_vertices for mesh in meshes]))
    size = float(np.abs(positions[used]).max())
    tolerance = min(COINCIDENCE_TOLERANCE * size, MAX_TOLERANCE_EDGES * min(mesh.mean_edge_length for mesh in meshes))
    pairs = used[scipy.spatial.cKDTree(positions[used]).query_pairs(tolerance, output_type="ndarray")]
    pairs = pairs[owner[pairs[:, 0]] != owner[pairs[:, 1]]]

    # The first vertex of each connected set of pairs, and the connected meshes
    part = connected_components(pairs, len(positions))
    _, first, which = np.unique(part, return_index=True, return_inverse=True)
    return first[which.reshape(-1)].astype(np.int64), connected_components(owner[pairs], len(meshes)).astype(np.int64)


def join_meshes(meshes: Sequence[Mesh], first: Ints) -> Joined:
    """Join meshes into one at the (k,) first coincident vertices that `coincident_vertices` returns."""
    kept = first == np.arange(len(first))
    vertices = (np.cumsum(kept) - 1)[first]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [vertices[start + mesh.faces] for start, mesh in zip(starts, meshes, strict=False)]
    positions = np.concatenate([mesh.vertices for mesh in meshes])
    return Joined(Mesh(positions[kept], np.concatenate(faces)), vertices)
