"""Find the copies of vertices that a file has split."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Bools, Ints, Ints32, any_in_rows, kernel


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
    bits = np.add(rows, 0.0, dtype=np.float64, order="C").view(np.int64)  # those of -0 become those of 0
    same, repeated = np.empty(len(rows), np.int64), np.zeros(len(rows), bool)
    places = np.full(2 << len(rows).bit_length(), -1, np.int32)
    return (same, repeated) if _find_equal(bits, places, same, repeated) else None


@kernel
def _find_equal(rows: Ints, places: Ints32, same: Ints, repeated: Bools) -> bool:
    """Find rows again in a hash table with linear probing, which is half full at most; whether any equals another."""
    any_repeated = False
    for i in range(len(rows)):
        # hash: multiply and fold the numbers, within 64 bits, so that every bit counts
        slot = np.int64(0)
        for column in range(rows.shape[1]):
            number = rows[i, column]
            product = (slot ^ ((number ^ (number >> 32)) & 0xFFFFFFFF)) * 0x7FEB352D
            slot = (product ^ (product >> 32)) & 0xFFFFFFFF

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
