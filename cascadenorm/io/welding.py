"""Find the copies of vertices that a file has split."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


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
    on_boundary = _on_boundary_edges(triangles, copied & (uses > 1)) | (copied & (uses == 1))
    target = np.arange(len(positions))
    first_there = np.full(len(positions), -1)
    boundary = np.flatnonzero(on_boundary)
    first_there[same[boundary[::-1]]] = boundary[::-1]
    target[boundary] = first_there[same[boundary]]
    first = np.flatnonzero(target == np.arange(len(target)))
    number = np.zeros(len(target), np.int32)
    number[first] = np.arange(len(first), dtype=np.int32)
    return number[target], first


def _same_place(positions: NDArray[Any]) -> NDArray[np.int64] | None:
    """Return for each position the number of some position with the same coordinates; None where all differ."""
    axes = range(positions.shape[1])
    keys = np.zeros(len(positions), np.uint64)
    for axis in axes:  # multiply and fold, so that every bit of every coordinate counts
        keys = (keys ^ _bits(positions[:, axis])) * np.uint64(0x9E3779B97F4A7C15)
        keys ^= keys >> np.uint64(29)
    order = np.argsort(keys)
    ordered = keys[order]
    starts = np.concatenate([[True], ordered[1:] != ordered[:-1]])[: len(ordered)]
    if starts.all():
        return None
    same = np.empty(len(positions), np.int64)
    same[order] = order[starts][np.cumsum(starts) - 1]
    if any((_bits(positions[:, axis])[same] != _bits(positions[:, axis])).any() for axis in axes):  # two share a key
        rows = np.stack([_bits(positions[:, axis]) for axis in axes], axis=1)
        _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        same = first[inverse.reshape(-1)]
    return same


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
