"""Meshes too large for a browser, with fewer faces."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Mesh

MOST_FACES = 1 << 20
"""Faces of a display mesh; twelve million bytes of a report, and seconds to open."""


class Display(NamedTuple):
    """What is shown of a mesh.

    Parameters
    ----------
    faces
        (f, 3) corners among the vertices that are kept.
    kept_vertices, kept_faces
        (v,) and (f,) the vertices and faces of the mesh that these stand for.
    """

    faces: NDArray[np.int32]
    kept_vertices: NDArray[np.int64]
    kept_faces: NDArray[np.int64]


def display(mesh: Mesh, *, most: int = MOST_FACES) -> Display:
    """Return the whole mesh, or where it has more than `most` faces one decimated by vertex clustering.

    One vertex stands for all in a cell of a grid, the nearest to the cell's centre, so that noise is not averaged
    away (Rossignac & Borrel 1993). The choice is by this mesh alone: other positions of the same vertices are shown
    with the same faces.
    """
    if len(mesh.faces) <= most:
        return Display(mesh.faces, np.arange(len(mesh.vertices)), np.arange(len(mesh.faces)))
    cell = 0.5 * mesh.mean_edge_length * np.sqrt(len(mesh.faces) / most)  # grows until few enough are left
    while True:
        stands_for = _representatives(mesh, cell)
        corners = stands_for[mesh.faces]
        a, b, c = corners.T
        kept = np.flatnonzero((a != b) & (b != c) & (c != a))
        kept = np.sort(kept[np.unique(np.sort(corners[kept], axis=1), axis=0, return_index=True)[1]])
        if len(kept) <= most:
            break
        cell *= max(1.05, np.sqrt(len(kept) / most))
    vertices, faces = np.unique(corners[kept], return_inverse=True)
    return Display(faces.reshape(-1, 3).astype(np.int32), vertices, kept)


def _representatives(mesh: Mesh, cell: float) -> NDArray[np.int64]:
    """For each vertex the one that stands for all in its cell, (n,)."""
    place = (mesh.vertices - mesh.vertices.min(axis=0)) / cell
    corner = np.floor(place).astype(np.int64)
    rows = np.ravel_multi_index(tuple(corner.T), tuple(corner.max(axis=0) + 1))
    away = np.square(place - corner - 0.5).sum(axis=1)
    order = np.lexsort((away, rows))
    first = np.concatenate([[True], np.diff(rows[order]) > 0])
    out = np.empty(len(rows), np.int64)
    out[order] = order[first][np.cumsum(first) - 1]
    return out
