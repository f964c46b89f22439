"""Welding of vertices that a file stores more than once."""

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.compute.equal_rows import first_equal
from cascadenorm.mesh import Bools, Ints, Ints32, Mesh, all_in_rows, any_in_rows, connected_components, marked

NEIGHBORS = 8
NEAR = 1e-3  # distance, in median edge lengths, within which boundary vertices nearly coincide


def weld(
    positions: NDArray[Any], triangles: Ints, parts: Ints | None = None, *, distance: float = 0.0
) -> tuple[Ints32, Ints]:
    """Weld boundary vertices at the same position, where a file has cut the surface.

    Coincident vertices inside a surface are not welded: there, two separate surfaces touch. The triangles, (m, 3),
    index the positions, (k, 3). Only positions of the same of the `parts`, (k,), are welded. Boundary vertices at most
    `distance` apart are welded too, repeatedly until none remain. Returns the (k,) welded vertex of each position, and
    (n,) the first position of each welded vertex, ascending.
    """
    number, first = _weld_equal(positions, triangles, parts)
    if not distance > 0:
        return number, first
    on_boundary = _on_boundary_edges(number[triangles].astype(np.int64), np.ones(len(first), bool))
    joined = near_on_boundary(positions[first], on_boundary, distance, None if parts is None else parts[first])
    kept, renumbered = np.unique(joined, return_inverse=True)
    return renumbered.ravel()[number].astype(np.int32), first[kept]


def near_on_boundary(points: NDArray[Any], on_boundary: Bools, distance: float, parts: Ints | None = None) -> Ints:
    """Cluster boundary vertices that are near each other, and return the first vertex of each one's cluster, (n,).

    Vertices of the same of the `parts`, (n,), are joined if they lie on the boundary and at most `distance` apart, in
    the unit of the points, (n, 3).
    """
    joined = np.arange(len(points))
    left = np.flatnonzero(on_boundary & np.isfinite(points).all(axis=1))
    rows = np.asarray(points, np.float64)
    if parts is not None:
        rows = np.column_stack([rows, 4 * distance * parts])
    found = first_equal(rows[left])
    if found is not None:
        joined[left] = left[found[0]]
        left = np.unique(joined[left])
    while distance > 0 and len(left) > 1:  # a few neighbours at a time: many vertices may share one position
        tree = scipy.spatial.cKDTree(rows[left])
        gaps, nearest = tree.query(rows[left], NEIGHBORS + 1, distance_upper_bound=distance * (1 + 1e-12))
        near, column = np.nonzero((gaps <= distance) & (nearest != np.arange(len(left))[:, None]))
        if not len(near):
            break
        links = np.stack([near, nearest[near, column]], axis=1)
        label = connected_components(links, len(left))
        _, leads = np.unique(label, return_index=True)
        target = np.arange(len(points))
        target[left] = left[leads[label]]
        joined, left = target[joined], left[leads]
    return joined


def nearly_coincident(mesh: Mesh) -> Bools:
    """Return (n,) whether each boundary vertex lies near an earlier one without coinciding with it."""
    points, on_boundary = mesh.vertices, mesh.topology.boundary_vertices
    if not on_boundary.any():
        return on_boundary
    equal, near = (near_on_boundary(points, on_boundary, d) for d in (0.0, NEAR * mesh.median_edge_length))
    return np.asarray(near != equal)


def _weld_equal(positions: NDArray[Any], triangles: Ints, parts: Ints | None) -> tuple[Ints32, Ints]:
    """Weld boundary vertices at exactly the same position; positions that are not finite are never the same."""
    found = first_equal(positions if parts is None else np.column_stack([positions, parts]))
    if found is None:
        return np.arange(len(positions), dtype=np.int32), np.arange(len(positions))
    same, copied = found[0], found[1] & all_in_rows(np.isfinite(positions))
    uses = np.bincount(triangles.ravel(), minlength=len(same))
    joins = _on_boundary_edges(triangles, copied & (uses > 1)) | (copied & (uses == 1))
    joined, leads, first_there = np.flatnonzero(joins), np.arange(len(same)), np.empty(len(same), np.int64)
    first_there[same[joined[::-1]]] = joined[::-1]  # of several at a place, the last one assigned remains
    leads[joined] = first_there[same[joined]]
    leading = leads == np.arange(len(same))
    return (np.cumsum(leading) - 1)[leads].astype(np.int32), np.flatnonzero(leading)


def _on_boundary_edges(triangles: Ints, candidates: Bools) -> Bools:
    """Return which candidates lie on an edge with a single triangle."""
    if not candidates.any():
        return candidates
    near = triangles[any_in_rows(candidates[triangles])]
    sides = np.sort(np.stack([near, np.roll(near, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    keys = sides[:, 0] * len(candidates) + sides[:, 1]
    _, first, counts = np.unique(keys, return_index=True, return_counts=True)
    on_boundary = marked(sides[first[counts == 1]], len(candidates))
    return on_boundary & candidates
