"""Recomputation of the normals stored in a file after vertices have moved."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.equal_rows import first_equal
from cascadenorm.mesh import Bools, Floats, Ints, Ints32, Vectors, any_in_rows, kernel, unit
from cascadenorm.mesh.polygons import near_one
from cascadenorm.mesh.vectors import area_vector, dot, row

NORMALS = ("Normals", "normals")  # names of normal arrays in VTK

RenewNormals = Callable[[NDArray[Any], NDArray[Any]], NDArray[Any]]
"""Function of normals and of their index at each triangle corner, as in `Normals`, that returns them recomputed."""

UNUSED, SHARED = -1, -2  # placeholders for the vertex of a normal that no vertex, or more than one, uses


class Normals(NamedTuple):
    """Normals as a file stores them."""

    values: NDArray[Any]  # (j, 3) as read; NaN where the file has none
    corners: Ints  # (m, 3) index of the normal at each triangle corner, or -1


def renewed_normals(
    normals: Normals, triangles: Ints, welds: Ints32, before: NDArray[Any], after: NDArray[Any]
) -> tuple[Floats, Bools]:
    """Recompute the normals of moved triangles as area-weighted means over the triangles that use each normal.

    Normals that were equal on both sides of a seam stay equal. If most stored normals are opposite to the orientation
    of the triangles, the new ones are too. The triangles, (m, 3), index the positions `before` and `after`, (k, 3), and
    `welds`, (k,), is the welded vertex of each position. Returns (j, 3) normals, and (j,) whether each was recomputed.
    Recomputed normals are unit vectors; the others are as read.
    """
    with np.errstate(invalid="ignore"):  # signalling NaN
        normals = normals._replace(values=normals.values.astype(np.float64))
    groups = _groups(normals, triangles, welds)
    old, new, moved = np.zeros((len(groups), 3)), np.zeros((len(groups), 3)), np.zeros(len(groups), bool)
    moves = any_in_rows(before != after)
    _sum_around(normals.corners, groups, triangles, moves, near_one(before), near_one(after), old, new, moved)
    renewed = np.zeros(len(groups), bool)
    _replace(normals.values, groups, old, unit(new), moved, renewed)
    return normals.values, renewed


def _groups(normals: Normals, triangles: Ints, welds: Ints32) -> Ints:
    """Return for each normal the first normal with the same value at a copy of the same vertex."""
    groups, owner = np.arange(len(normals.values)), np.full(len(normals.values), UNUSED, np.int32)
    if normals.corners is triangles and welds[-1] == len(welds) - 1:  # a normal for each position, and none is a copy
        return groups
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
    """Record the vertex that uses each normal, or SHARED if several do."""
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
    """Sum the area vectors of the triangles that use each group, and record whether any of them moves."""
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
    """Replace and mark the normals of moved groups; reverse them if most stored normals oppose the old sums."""
    balance = 0
    for i in range(len(values)):
        along = dot(row(old, groups[i]), row(values, i))
        balance += int(along > 0) - int(along < 0)
    for i in range(len(values)):
        x, y, z = row(new, groups[i])
        if moved[groups[i]] and (x != 0 or y != 0 or z != 0):
            renewed[i] = True
            values[i, 0], values[i, 1], values[i, 2] = (x, y, z) if balance >= 0 else (-x, -y, -z)
