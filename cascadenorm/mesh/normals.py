"""Normals that a file stores, made anew where its vertices have moved."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Bools, Ints, Ints32, Vectors, any_in_rows, kernel, unit
from cascadenorm.mesh.polygons import near_one
from cascadenorm.mesh.vectors import area_vector, dot, row
from cascadenorm.mesh.welding import first_equal

NORMALS = ("Normals", "normals")
"""What normals are called in VTK."""

UNUSED, SHARED = -1, -2
"""In place of the vertex at which a normal is used: where there is none, or several."""


class Normals(NamedTuple):
    """Normals as a file stores them.

    Parameters
    ----------
    values
        (j, 3) as read; not a number where the file has none.
    corners
        (m, 3) the normal that each corner of each triangle uses, or -1.
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
    normals
        As read.
    triangles
        (m, 3) rows of positions.
    welds
        (k,) welded vertex of each position.
    before, after
        (k, 3) positions.

    Returns
    -------
    (j, 3) unit normals, and (j,) which of them are new; the others are as read
    """
    with np.errstate(invalid="ignore"):  # a NaN may be a signalling one
        normals = normals._replace(values=normals.values.astype(np.float64))
    groups = _groups(normals, triangles, welds)
    old, new, moved = np.zeros((len(groups), 3)), np.zeros((len(groups), 3)), np.zeros(len(groups), bool)
    moves = any_in_rows(before != after)
    _sum_around(normals.corners, groups, triangles, moves, near_one(before), near_one(after), old, new, moved)
    renewed = np.zeros(len(groups), bool)
    _replace(normals.values, groups, old, unit(new), moved, renewed)
    return normals.values, renewed


def _groups(normals: Normals, triangles: NDArray[np.int64], welds: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return for each normal the first one that has the same value at a copy of the same vertex."""
    groups, owner = np.arange(len(normals.values)), np.full(len(normals.values), UNUSED, np.int32)
    _find_owners(normals.corners, triangles, welds, owner)
    candidates = np.flatnonzero(owner >= 0)
    candidates = candidates[np.bincount(owner[candidates], minlength=1)[owner[candidates]] > 1]
    candidates = candidates[~any_in_rows(np.isnan(normals.values[candidates]))]  # NaN is not equal to NaN here
    found = first_equal(np.column_stack([owner[candidates], normals.values[candidates]]))
    if found is not None:
        groups[candidates] = candidates[found[0]]
    return groups


@kernel
def _find_owners(corners: Ints, triangles: Ints, welds: Ints32, owner: Ints32) -> None:
    """Note the vertex at which each normal is used; one that is used at several is in a group of its own."""
    for f in range(len(corners)):
        for k in range(3):
            slot = corners[f, k]
            if slot >= 0 and owner[slot] != welds[triangles[f, k]]:
                owner[slot] = welds[triangles[f, k]] if owner[slot] == UNUSED else SHARED


@kernel
def _sum_around(
    corners: Ints,
    groups: Ints,
    triangles: Ints,
    moves: Bools,
    before: Vectors,
    after: Vectors,
    old: Vectors,
    new: Vectors,
    moved: Bools,
) -> None:
    """Add the area vectors of the triangles that use each group, and tell whether one of them moves."""
    for f in range(len(corners)):
        a, b, c = triangles[f, 0], triangles[f, 1], triangles[f, 2]
        moving = moves[a] or moves[b] or moves[c]
        area_before = area_vector(row(before, a), row(before, b), row(before, c))
        area_after = area_vector(row(after, a), row(after, b), row(after, c))
        for k in range(3):
            if corners[f, k] >= 0:
                group = groups[corners[f, k]]
                moved[group] |= moving
                for axis in range(3):
                    old[group, axis] += area_before[axis]
                    new[group, axis] += area_after[axis]


@kernel
def _replace(values: Vectors, groups: Ints, old: Vectors, new: Vectors, moved: Bools, renewed: Bools) -> None:
    """Replace the values of groups that moved, and tell which; reversed where most were opposite to the old sums."""
    balance = 0
    for i in range(len(values)):
        along = dot(row(old, groups[i]), row(values, i))
        balance += int(along > 0) - int(along < 0)
    for i in range(len(values)):
        x, y, z = row(new, groups[i])
        if moved[groups[i]] and (x != 0 or y != 0 or z != 0):
            renewed[i] = True
            values[i, 0], values[i, 1], values[i, 2] = (x, y, z) if balance >= 0 else (-x, -y, -z)
