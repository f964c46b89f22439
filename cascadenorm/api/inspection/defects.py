"""Detect boundaries, non-manifold edges and vertices, duplicates, slivers and spikes, and measure closed components."""

from typing import NamedTuple

import numpy as np

from cascadenorm.compute.arrays import Bools, Floats, Ints, Ints32, Vectors, first_of_each, pair_products, scatter_add
from cascadenorm.geometry.volume import closed_parts, volumes
from cascadenorm.mesh import Mesh, Topology, connected_components, kernel, marked, parallel_for
from cascadenorm.mesh.vectors import cross, dot, length, row, subtract

FLAT_HEIGHT = 1e-12  # ratio of height to longest edge up to which a face counts as degenerate
SPIKE = np.radians(150)
"""Angle sum at a vertex, 360° in a plane, below which it is a spike; corresponds to a cone of half-angle 25°."""
THIN = 0.01  # ratio of height to longest edge below which a face is a sliver
FOLDED_COSINE = -1e-6
"""Cosine of the angle between the normals of adjacent faces below which an edge is folded: 90° except for rounding."""


def flipped_edges(topology: Topology) -> Bools:
    """Return (e,) bool, the edges whose two faces traverse them in the same direction."""
    return np.asarray((topology.edge_faces.counts == 2) & (topology.balance != 0))


def pinched_vertices(topology: Topology) -> Bools:
    """Return (n,) bool, the vertices whose faces form two or more fans that are not connected at the vertex."""
    fans = topology.fans()
    vertex_of_fan = np.zeros(fans.max(initial=-1) + 1, np.int64)
    vertex_of_fan[fans] = topology.faces.ravel()
    return np.asarray(np.bincount(vertex_of_fan, minlength=topology.vertex_count) > 1)


def boundary_loop_count(topology: Topology) -> int:
    """Return the number of connected chains of boundary edges."""
    boundary = topology.edges[topology.edge_faces.counts == 1]
    part = connected_components(boundary, topology.vertex_count)
    return len(np.unique(part[boundary]))


def thin_faces(mesh: Mesh) -> tuple[Bools, Bools]:
    """Return (m,) bool twice: the faces with zero area up to rounding, and the other slivers."""
    flat = mesh.heights <= FLAT_HEIGHT * mesh.longest_edges
    return np.asarray(flat), np.asarray(~flat & (mesh.heights < THIN * mesh.longest_edges))


def spikes(mesh: Mesh) -> Bools:
    """Return (n,) bool, the interior vertices whose angle sum is less than SPIKE."""
    angles = np.empty(mesh.faces.shape)
    parallel_for(len(angles), _angle_range, mesh.vertices, mesh.faces, angles)
    sums = scatter_add(mesh.faces.ravel(), angles.ravel(), len(mesh.vertices))
    inner = mesh.topology.used_vertices & ~mesh.topology.boundary_vertices
    return np.asarray(inner & (sums < SPIKE))


def folded_edges(mesh: Mesh) -> Bools:
    """Return (i,) bool, the interior edges whose faces have normals more than 90° apart if consistently oriented."""
    topology = mesh.topology
    cosines = pair_products(mesh.face_normals, topology.face_pairs)
    cosines[flipped_edges(topology)[topology.interior_edges]] *= -1
    return np.asarray(cosines < FOLDED_COSINE)


class Enclosed(NamedTuple):
    """The closed, consistently oriented components of a mesh."""

    faces: Ints  # (c,) first face of each component
    volumes: Floats  # (c,) signed volumes; negative for components that are inside out
    # (c,) Euler characteristics V - E + F, which are 2 - 2 · handles for manifold components
    characteristics: Ints
    manifold: Bools  # (c,) bool, whether every vertex of the component has a single fan of faces


def enclosed(mesh: Mesh, pinched: Bools) -> Enclosed:
    """Measure the closed components of a mesh; pinched vertices, (n,) bool, have several fans of faces."""
    closed = closed_parts(mesh)
    number, total = closed
    of_face, of_edge = number[mesh.faces[:, 0]], number[mesh.topology.edges[:, 0]]
    inside = np.flatnonzero(of_face >= 0)
    counts = [np.bincount(of[of >= 0], minlength=total) for of in (number, of_edge, of_face)]
    of_pinched = number[pinched]
    manifold = ~marked(of_pinched[of_pinched >= 0], total)
    first = inside[first_of_each(of_face[inside])]
    return Enclosed(first, volumes(mesh, closed), counts[0] - counts[1] + counts[2], manifold)


@kernel
def _angle_range(start: int, stop: int, vertices: Vectors, faces: Ints32, out: Floats) -> None:
    for f in range(start, stop):
        for k in range(3):
            corner = row(vertices, faces[f, k])
            onward = subtract(row(vertices, faces[f, (k + 1) % 3]), corner)
            backward = subtract(row(vertices, faces[f, (k + 2) % 3]), corner)
            out[f, k] = np.arctan2(length(cross(onward, backward)), dot(onward, backward))
