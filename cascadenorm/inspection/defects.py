"""Places where a mesh is no clean surface: boundaries, edges and vertices that are not manifold, copies, slivers."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Mesh, Topology, connected_components, scatter_add

Mask = NDArray[np.bool_]

FLAT_HEIGHT = 1e-12
"""A face whose height is smaller than this share of its longest side has no area but by rounding."""
SPIKE = np.radians(150)
"""Sum of the angles of the faces at a vertex, 360° in a plane, below which it is a spike: a cone of half-angle 25°."""
THIN = 0.01
"""A face whose height is smaller than this share of its longest side is a sliver."""


def flipped_edges(topology: Topology) -> Mask:
    """Return which edges have two faces that run along them the same way, (e,)."""
    return np.asarray((topology.edge_faces.counts == 2) & (topology.balance != 0))


def pinched_vertices(topology: Topology) -> Mask:
    """Return the vertices whose faces do not are connected across edges at that vertex, (n,): two fans or more."""
    fans = topology.fans()
    vertex_of_fan = np.zeros(fans.max(initial=-1) + 1, np.int64)
    vertex_of_fan[fans] = topology.faces.ravel()
    return np.asarray(np.bincount(vertex_of_fan, minlength=topology.vertex_count) > 1)


def boundary_loop_count(topology: Topology) -> int:
    """Return the number of connected chains of edges that have a single face."""
    boundary = topology.edges[topology.edge_faces.counts == 1]
    part = connected_components(boundary, topology.vertex_count)
    return len(np.unique(part[boundary]))


def thin_faces(mesh: Mesh) -> tuple[Mask, Mask]:
    """Return which faces have no area but by rounding, and which others are slivers; each (m,)."""
    flat = mesh.heights <= FLAT_HEIGHT * mesh.longest_edges
    return np.asarray(flat), np.asarray(~flat & (mesh.heights < THIN * mesh.longest_edges))


def spikes(mesh: Mesh) -> Mask:
    """Return which inner vertices are spikes, (n,): the angles of their faces add up to less than SPIKE."""
    onward = np.roll(mesh.corners, -1, axis=1) - mesh.corners
    backward = np.roll(mesh.corners, 1, axis=1) - mesh.corners
    sines = np.linalg.norm(np.cross(onward, backward), axis=2)
    angles = np.arctan2(sines, (onward * backward).sum(axis=2))
    sums = scatter_add(mesh.faces.ravel(), angles.ravel(), len(mesh.vertices))
    inner = mesh.topology.used_vertices.copy()
    inner[mesh.topology.edges[mesh.topology.edge_faces.counts == 1]] = False
    return np.asarray(inner & (sums < SPIKE))


def repeats(rows: NDArray[Any]) -> tuple[Mask, NDArray[np.int64]]:
    """Return which rows came before, and for each row the first that is equal; both (k,)."""
    order = np.lexsort(rows.T[::-1])
    new = np.ones(len(rows), bool)
    new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    first = np.empty(len(rows), np.int64)
    first[order] = order[new][np.cumsum(new) - 1]
    return np.asarray(first != np.arange(len(rows))), first
