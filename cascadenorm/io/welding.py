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
    """Return for each position the first with the same coordinates; None where all differ."""
    keys = np.zeros(len(positions), np.uint64)
    for axis in range(positions.shape[1]):  # multiply and fold, so that every bit of every coordinate counts
        keys ^= _bits(positions[:, axis])
        keys *= np.uint64(0x9E3779B97F4A7C15)
        keys ^= keys >> np.uint64(29)
    same = np.empty(len(positions), np.int64)
    bits = len(positions).bit_length() + 1
    places = np.full(1 << bits, -1, np.int32)
    return same if _first_there(keys >> np.uint64(64 - bits), positions, places, same) else None


@kernel
def _first_there(slots: NDArray[np.uint64], positions: NDArray[Any], places: Ints32, same: Ints) -> bool:
    """Find positions again in a hash table with linear probing, from these slots on; it is half full at most.

    Returns whether any has the coordinates of one before; NaN equals NaN.
    """
    any_again = False
    for i in range(len(positions)):
        slot = np.int64(slots[i])
        same[i] = i
        while places[slot] >= 0:
            differs, before = False, places[slot]
            for axis in range(positions.shape[1]):
                one, other = positions[i, axis], positions[before, axis]
                differs |= one != other and not (np.isnan(one) and np.isnan(other))
            if not differs:
                same[i], any_again = before, True
                break
            slot = (slot + 1) & (len(places) - 1)
        if same[i] == i:
            places[slot] = i
    return any_again


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
