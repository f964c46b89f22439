"""Normals that a file stores, made anew where its vertices have moved."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.io.polygons import area_vectors
from cascadenorm.mesh import unit


class Normals(NamedTuple):
    """Normals as a file stores them.

    Parameters
    ----------
    values : (j, 3) as read; not a number where the file has none
    corners : (m, 3) the normal that each corner of each triangle uses, or -1
    """

    values: NDArray[np.float64]
    corners: NDArray[np.int64]


def renewed_normals(
    normals: Normals,
    triangles: NDArray[np.int64],
    welds: NDArray[np.int32],
    before: NDArray[Any],
    after: NDArray[Any],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Recompute the normals of triangles that moved: the mean, by area, of the triangles that use each.

    Normals that were equal on both sides of a seam stay equal. If most were opposite to the triangles' own
    orientation, the new ones are as well.

    Parameters
    ----------
    normals : as read
    triangles : (m, 3) rows of positions
    welds : (k,) welded vertex of each position
    before, after : (k, 3) positions

    Returns
    -------
    (j, 3) unit normals, and (j,) which of them are new; the others are as read
    """
    used = normals.corners >= 0
    slots = normals.corners[used]
    groups = _groups(normals, slots, welds[triangles[used]])
    old = _sums(groups, slots, area_vectors(before, triangles), used)
    new = unit(_sums(groups, slots, area_vectors(after, triangles), used))
    if np.nansum(np.sign(np.einsum("ij,ij->i", old, normals.values))) < 0:
        new = -new
    moved = np.zeros(len(groups), bool)
    moved[groups[slots[(before != after).any(axis=1)[triangles].any(axis=1).repeat(3).reshape(-1, 3)[used]]]] = True
    renewed = moved[groups] & new.any(axis=1)
    return np.where(renewed[:, None], new, normals.values), renewed


def _groups(normals: Normals, slots: NDArray[np.int64], vertices: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return for each normal a number shared by equal normals of copies of one vertex."""
    owner = np.full(len(normals.values), -1)
    owner[slots] = vertices
    shared = np.zeros(len(owner), bool)
    shared[slots[owner[slots] != vertices]] = True  # used at several vertices: a group of its own
    rows = np.column_stack([owner.astype(np.float64), normals.values])
    _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    return np.where(shared | (owner < 0), np.arange(len(owner)), first[inverse.reshape(-1)])


def _sums(
    groups: NDArray[np.int64], slots: NDArray[np.int64], vectors: NDArray[np.float64], used: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return for each normal the sum over its group of the vectors of the triangles that use it."""
    rows = np.broadcast_to(np.arange(len(vectors))[:, None], used.shape)[used]
    target = groups[slots]
    sums = [np.bincount(target, vectors[rows, axis], minlength=len(groups)) for axis in range(3)]
    return np.stack(sums, axis=1)[groups]
