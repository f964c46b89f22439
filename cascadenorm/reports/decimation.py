"""Decimation of meshes that are too large for a browser."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Mesh, first_of_each, repeats, repeats_vertex

MOST_SHOWN_FACES = 1 << 20  # largest number of faces of a displayed mesh, for reports below 12 MB that open in seconds


class Display(NamedTuple):
    """The vertices and faces of a mesh that are displayed."""

    faces: NDArray[np.int32]  # (f, 3) indices into the kept vertices
    # kept_vertices, kept_faces: (v,) and (f,) indices of the kept vertices and faces in the mesh
    kept_vertices: NDArray[np.int64]
    kept_faces: NDArray[np.int64]


def decimated(mesh: Mesh, *, most: int = MOST_SHOWN_FACES) -> Display:
    """Return the whole mesh, decimated by vertex clustering if it has more than `most` faces.

    In each cell of a grid, the vertex nearest to the centre represents all others, so that noise is not averaged away
    (Rossignac & Borrel 1993). The choice depends on this mesh only: other positions of the same vertices can be shown
    with the same faces.
    """
    if len(mesh.faces) <= most:
        return Display(mesh.faces, np.arange(len(mesh.vertices)), np.arange(len(mesh.faces)))
    cell = 0.5 * mesh.mean_edge_length * np.sqrt(len(mesh.faces) / most)  # grows until few enough are left
    while True:
        stands_for = _representatives(mesh, cell)
        corners = stands_for[mesh.faces]
        kept = np.flatnonzero(~repeats_vertex(corners))
        kept = kept[~repeats(np.sort(corners[kept], axis=1))[0]]
        if len(kept) <= most:
            break
        cell *= max(1.05, np.sqrt(len(kept) / most))
    vertices, faces = np.unique(corners[kept], return_inverse=True)
    return Display(faces.reshape(-1, 3).astype(np.int32), vertices, kept)


def _representatives(mesh: Mesh, cell: float) -> NDArray[np.int64]:
    """Return (n,) for each vertex the one that represents its cell."""
    place = (mesh.vertices - mesh.vertices.min(axis=0)) / cell
    corner = np.floor(place).astype(np.int64)
    _, cells = np.unique(np.ravel_multi_index(tuple(corner.T), tuple(corner.max(axis=0) + 1)), return_inverse=True)
    order = np.argsort(np.square(place - corner - 0.5).sum(axis=1), kind="stable")
    return order[first_of_each(cells[order])][cells]
