"""Detection of steps from quantised heights or depths."""

from dataclasses import dataclass

import numpy as np

from cascadenorm.mesh import Mesh, connected_components

FLAT = 1e-3
"""Largest angle in radians between the normals of adjacent faces of a tread."""
FEWEST_FACES = 8
"""Least number of faces of a tread; fewer may be coplanar by chance, as in marching tetrahedra."""
FEWEST_TREADS = 12
SHARE = 0.5
"""Least fraction of the area that lies on parallel treads."""
PARALLEL = 1e-4
"""Largest 1 - cosine of the angle between the normals of parallel treads."""
NARROWEST = 5.0
"""Least width in mean edge lengths; `auto` removes narrower steps by itself."""


@dataclass(frozen=True, kw_only=True)
class Treads:
    """Flat, parallel treads that cover most of a mesh."""

    count: int
    width: float  # of a typical tread with its riser, in mean edge lengths


def treads(mesh: Mesh) -> Treads | None:
    """Find the steps of quantisation on a height field or depth image; return None if there are none.

    A tread is a connected set of coplanar faces. Its width is its hydraulic diameter: four times the area divided by
    the perimeter. The typical width is the area-weighted mean, so that the many small treads of steep parts have little
    weight.
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
