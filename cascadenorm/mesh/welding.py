"""Find the copies of vertices that a file has split."""

import secrets
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.mesh import Bools, Ints, Ints32, Mesh, any_in_rows, connected_components, kernel

PRIME = 2**31 - 1
NEIGHBORS = 8
NEAR = 1e-3
"""Median edge lengths: boundary vertices that are at most this far apart nearly coincide."""


def weld(
    positions: NDArray[Any],
    triangles: NDArray[np.int64],
    parts: NDArray[np.int64] | None = None,
    *,
    distance: float = 0.0,
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Join vertices that lie at the same place on the boundary of the mesh: there a file has cut it.

    Copies inside a surface are left apart: there two surfaces touch that the file keeps apart.

    Parameters
    ----------
    positions
        (k, 3).
    triangles
        (m, 3) rows of positions.
    parts
        (k,) only positions of the same part are joined.
    distance
        Boundary vertices that are at most this far apart are joined as well, until none that are left are.

    Returns
    -------
    (k,) welded vertex of each position, and (n,) the first position of each welded vertex, ascending
    """
    number, first = _weld_equal(positions, triangles, parts)
    if not distance > 0:
        return number, first
    on_boundary = _on_boundary_edges(number[triangles].astype(np.int64), np.ones(len(first), bool))
    joined = near_on_boundary(positions[first], on_boundary, distance, None if parts is None else parts[first])
    kept, renumbered = np.unique(joined, return_inverse=True)
    return renumbered.ravel()[number].astype(np.int32), first[kept]


def near_on_boundary(
    points: NDArray[Any], on_boundary: NDArray[np.bool_], distance: float, parts: NDArray[np.int64] | None = None
) -> NDArray[np.int64]:
    """Return (n,) for each vertex the first one that it is joined with, over boundary vertices near one to the next.

    Parameters
    ----------
    points
        (n, 3).
    on_boundary
        (n,).
    distance
        Between two that are joined at most, in the unit of the points.
    parts
        (n,) only vertices of the same part are joined.
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
    while distance > 0 and len(left) > 1:  # a few neighbours at a time, since there may be many in one place
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


def nearly_coincident(mesh: Mesh) -> NDArray[np.bool_]:
    """Return (n,) which boundary vertices lie near an earlier one, at another place and not joined with it."""
    points, on_boundary = mesh.vertices, mesh.topology.boundary_vertices
    if not on_boundary.any():
        return on_boundary
    equal, near = (near_on_boundary(points, on_boundary, d) for d in (0.0, NEAR * mesh.median_edge_length))
    return np.asarray(near != equal)


def _weld_equal(
    positions: NDArray[Any], triangles: NDArray[np.int64], parts: NDArray[np.int64] | None
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Join vertices at exactly the same place."""
    found = first_equal(positions if parts is None else np.column_stack([positions, parts]))
    if found is None:
        return np.arange(len(positions), dtype=np.int32), np.arange(len(positions))
    same, copied = found
    uses = np.bincount(triangles.ravel(), minlength=len(same))
    joins = _on_boundary_edges(triangles, copied & (uses > 1)) | (copied & (uses == 1))
    number, first = np.empty(len(same), np.int32), np.empty(len(same), np.int64)
    return number, first[: _number(same, joins, number, first)].copy()


def first_equal(rows: NDArray[Any]) -> tuple[NDArray[np.int64], NDArray[np.bool_]] | None:
    """Return for each row of floating-point numbers the first that is equal to it, and which equal another one.

    None where all differ; NaN equals NaN of the same bits.
    """
    with np.errstate(invalid="ignore"):  # signalling NaN
        bits = np.add(rows, 0.0, dtype=np.float64, order="C").view(np.int64)  # those of -0 become those of 0
    same, repeated = np.empty(len(rows), np.int64), np.zeros(len(rows), bool)
    places = np.full(2 << len(rows).bit_length(), -1, np.int32)
    factors = np.array([1 + secrets.randbelow(PRIME - 1) for _ in range(3 * bits.shape[1])])
    return (same, repeated) if _find_equal(bits, factors, places, same, repeated) else None


@kernel
def _find_equal(rows: Ints, factors: Ints, places: Ints32, same: Ints, repeated: Bools) -> bool:
    """Find rows again in a hash table with linear probing, which is half full at most; whether any equals another.

    The hash is a sum of products with random factors (Carter, Wegman 1979), so that no file can be made to collide.
    """
    any_repeated = False
    for i in range(len(rows)):
        # hash: the 22, 21 and 21 bits of each number times a factor, within 64 bits, modulo a prime, then folded
        slot = np.int64(0)
        for column in range(rows.shape[1]):
            number = rows[i, column]
            slot += (number & 0x3FFFFF) * factors[3 * column]
            slot += ((number >> 22) & 0x1FFFFF) * factors[3 * column + 1]
            slot += ((number >> 43) & 0x1FFFFF) * factors[3 * column + 2]
        slot = (slot % PRIME) * 0x7FEB352D
        slot = (slot ^ (slot >> 32)) & 0xFFFFFFFF

        # probe from there until the row is found, or a free place
        slot &= len(places) - 1
        same[i] = i
        while places[slot] >= 0:
            differs, before = False, places[slot]
            for column in range(rows.shape[1]):
                differs |= rows[i, column] != rows[before, column]
            if not differs:
                same[i] = before
                repeated[i] = repeated[before] = any_repeated = True
                break
            slot = (slot + 1) & (len(places) - 1)
        if same[i] == i:
            places[slot] = i
    return any_repeated


@kernel
def _number(same: Ints, joins: Bools, number: Ints32, first: Ints) -> int:
    """Number the positions, those that join as the first of their place that does; what each number began with."""
    count = 0
    first_there = np.full(len(same), -1, np.int32)  # the number of those that join
    for i in range(len(same)):
        if joins[i] and first_there[same[i]] >= 0:
            number[i] = first_there[same[i]]
            continue
        if joins[i]:
            first_there[same[i]] = count
        number[i], first[count] = count, i
        count += 1
    return count


def _on_boundary_edges(triangles: NDArray[np.int64], candidates: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which of the candidates lie on an edge with a single triangle."""
    if not candidates.any():
        return candidates
    near = triangles[any_in_rows(candidates[triangles])]
    sides = np.sort(np.stack([near, np.roll(near, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    keys = sides[:, 0] * len(candidates) + sides[:, 1]
    _, first, counts = np.unique(keys, return_index=True, return_counts=True)
    on_boundary = np.zeros(len(candidates), bool)
    on_boundary[sides[first[counts == 1]]] = True
    return on_boundary & candidates
