"""Normals that a file stores, made anew where its vertices have moved."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.io.polygons import area_vectors
from cascadenorm.mesh import any_in_rows, scatter_add, unit

NORMALS = ("Normals", "normals")
"""What normals are called in VTK."""


class Normals(NamedTuple):
    """Normals as a file stores them.

    Parameters
    ----------
    values : (j, 3) as read; not a number where the file has none
    corners : (m, 3) the normal that each corner of each triangle uses, or -1
    """

    values: NDArray[Any]
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
    with np.errstate(invalid="ignore"):  # a NaN may be a signalling one
        normals = normals._replace(values=normals.values.astype(np.float64))
    rows, columns = np.nonzero(normals.corners >= 0)
    slots = normals.corners[rows, columns]
    groups = _groups(normals, slots, welds[triangles[rows, columns]])
    users = groups[slots]
    old = scatter_add(users, area_vectors(before, triangles)[rows], len(groups))
    new = unit(scatter_add(users, area_vectors(after, triangles)[rows], len(groups)))[groups]
    if np.nansum(np.sign(np.einsum("ij,ij->i", old[groups], normals.values))) < 0:
        new = -new
    moved = np.zeros(len(groups), bool)
    moved[users[any_in_rows(any_in_rows(before != after)[triangles])[rows]]] = True
    renewed = moved[groups] & any_in_rows(new != 0)
    return np.where(renewed[:, None], new, normals.values), renewed


def _groups(normals: Normals, slots: NDArray[np.int64], vertices: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return for each normal the first one that has the same value at a copy of the same vertex."""
    groups = np.arange(len(normals.values))
    owner = np.full(len(groups), -1)
    owner[slots] = vertices
    owner[slots[owner[slots] != vertices]] = -1  # used at several vertices: a group of its own
    candidates = np.flatnonzero(owner >= 0)
    candidates = candidates[np.bincount(owner[candidates], minlength=1)[owner[candidates]] > 1]
    if len(candidates):
        rows = np.column_stack([owner[candidates], normals.values[candidates]])
        _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        groups[candidates] = candidates[first[inverse.reshape(-1)]]
    return groups
