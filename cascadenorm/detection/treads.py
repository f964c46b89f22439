"""Steps of rounded heights or depths: many flat, parallel treads, whose typical width a user needs to know."""

from dataclasses import dataclass

import numpy as np

from cascadenorm.mesh import Mesh, connected_components

FLAT = 1e-3
"""Radians between the normals of neighbouring faces of one tread, at most."""
FEWEST_FACES = 8
"""Faces of a tread; fewer are coplanar by chance, as the quadrangles of marching tetrahedra."""
FEWEST_TREADS = 12
SHARE = 0.5
"""Share of the area that lies on parallel treads."""
PARALLEL = 1e-4
"""1 - cosine of the angle between the normals of parallel treads, at most."""
NARROWEST = 5.0
"""Mean edge lengths: `auto` removes narrower steps by itself."""


@dataclass(frozen=True, kw_only=True)
class Treads:
    """Flat, parallel treads that cover most of a mesh.

    Parameters
    ----------
    count
        Number of treads.
    width
        Of a typical one with the rise beside it, in mean edge lengths.
    """

    count: int
    width: float


def treads(mesh: Mesh) -> Treads | None:
    """Find the steps that rounding leaves on a height field or a depth image; None where there are none.

    A tread is a set of connected faces in one plane. Its width is its hydraulic diameter, four times the area over the
    perimeter, and the typical width is the mean by area, so that the many small treads of steep parts count little.

    Parameters
    ----------
    mesh
        Mesh with m faces.
    """
    pairs = mesh.topology.face_pairs
    normals, areas = mesh.face_normals, mesh.areas
    if not mesh.mean_edge_length > 0 or not len(pairs):
        return None
    joined = np.einsum("ij,ij->i", *normals[pairs.T]) > np.cos(FLAT)
    labels = connected_components(pairs[joined], len(mesh.faces))
    tread_areas = np.bincount(labels, weights=areas)
    _, first = np.unique(labels, return_index=True)
    along = np.abs(normals[first] @ normals[first[np.argmax(tread_areas)]]) > 1 - PARALLEL
    large = along & (np.bincount(labels) >= FEWEST_FACES)
    if large.sum() < FEWEST_TREADS or tread_areas[large].sum() < SHARE * mesh.area:
        return None
    ends = mesh.topology.edges[mesh.topology.interior_edges[~joined]]
    lengths = np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1)
    perimeters = np.zeros(len(large))
    for side in pairs[~joined].T:
        perimeters += np.bincount(labels[side], weights=lengths, minlength=len(large))
    kept = large & (perimeters > 0)
    widths = 4 * tread_areas[kept] / perimeters[kept]
    width = 1 + float(np.average(widths, weights=tread_areas[kept])) / mesh.mean_edge_length
    return Treads(count=int(kept.sum()), width=width) if width >= NARROWEST else None
