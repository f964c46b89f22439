"""Find the copies of vertices that a file has split."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Bools, Ints, Ints32, kernel


def weld(
    positions: NDArray[Any], triangles: NDArray[np.int64], parts: NDArray[np.int64] | None = None
) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Join vertices that lie at the same place on the boundary of the mesh: there a file has cut it.

    Copies inside a surface are left apart: there two surfaces touch that the file keeps apart.

    Parameters
    ----------
    positions : (k, 3)
    triangles : (m, 3) rows of positions
    parts : (k,) only positions of the same part are joined

    Returns
    -------
    (k,) welded vertex of each position, and (n,) the first position of each welded vertex, ascending
    """
    same = _same_place(positions if parts is None else np.column_stack([positions, parts]))
    if same is None:
        return np.arange(len(positions), dtype=np.int32), np.arange(len(positions))
    copied = np.bincount(same, minlength=len(same))[same] > 1
    uses = np.bincount(triangles.ravel(), minlength=len(same))
    joins = _on_boundary_edges(triangles, copied & (uses > 1)) | (copied & (uses == 1))
    number, first = np.empty(len(same), np.int32), np.empty(len(same), np.int64)
    return number, first[: _number(same, joins, number, first)].copy()


def _same_place(positions: NDArray[Any]) -> NDArray[np.int64] | None:
    """Return for each position the number of some position with the same coordinates; None where all differ."""
    axes = range(positions.shape[1])
    keys = np.zeros(len(positions), np.uint64)
    for axis in axes:  # multiply and fold, so that every bit of every coordinate counts
        keys ^= _bits(positions[:, axis])
        keys *= np.uint64(0x9E3779B97F4A7C15)
        keys ^= keys >> np.uint64(29)
    order = np.argsort(keys)
    same = np.empty(len(positions), np.int64)
    groups, two_share_a_key = _group(order, keys, positions, same)
    if two_share_a_key:
        rows = np.stack([_bits(positions[:, axis]) for axis in axes], axis=1)
        _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        same = first[inverse.reshape(-1)]
    return None if groups == len(same) else same


@kernel
def _group(order: Ints, keys: NDArray[np.uint64], positions: NDArray[Any], same: Ints) -> tuple[int, bool]:
    """Number each position by the first in the order that has its key.

    Returns how many keys there are, and whether different positions share one.
    """
    groups, differs = 0, False
    first = 0
    for k in range(len(order)):
        i = order[k]
        if k == 0 or keys[i] != keys[first]:
            first = i
            groups += 1
        same[i] = first
        for axis in range(positions.shape[1]):
            one, other = positions[i, axis], positions[first, axis]
            differs |= one != other and not (np.isnan(one) and np.isnan(other))
    return groups, differs


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


def _bits(coordinates: NDArray[Any]) -> NDArray[np.uint64]:
    return (coordinates.astype(np.float64) + 0.0).view(np.uint64)  # adding 0 makes -0 equal to 0


def _on_boundary_edges(triangles: NDArray[np.int64], candidates: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which of the candidates lie on an edge with a single triangle."""
    near = triangles[candidates[triangles].any(axis=1)]
    sides = np.sort(np.stack([near, np.roll(near, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    keys = sides[:, 0] * len(candidates) + sides[:, 1]
    _, first, counts = np.unique(keys, return_index=True, return_counts=True)
    on_boundary = np.zeros(len(candidates), bool)
    on_boundary[sides[first[counts == 1]]] = True
    return on_boundary & candidates
