"""Bad vertices and faces, and the mesh without them, so that one bad number does not spoil the rest."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.compute.arrays import all_in_rows
from cascadenorm.errors import MeshError
from cascadenorm.mesh.mesh import Mesh, face_array, vertex_array


def bad_vertices(vertices: ArrayLike) -> NDArray[np.bool_]:
    """Return which vertices are not finite, (n,)."""
    return ~all_in_rows(np.isfinite(vertex_array(vertices)))


def bad_faces(vertices: ArrayLike, faces: ArrayLike) -> NDArray[np.bool_]:
    """Return which faces reference a vertex that does not exist or is not finite, or one vertex twice, (m,)."""
    corners, bad = face_array(faces), bad_vertices(vertices)
    out_of_range = (corners < 0) | (corners >= len(bad))
    touching = np.append(bad, True)[np.where(out_of_range, len(bad), corners)].any(axis=1)
    return np.asarray(touching | repeats_vertex(corners))


def repeats_vertex(faces: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which faces, (m, 3), repeat a vertex, (m,)."""
    a, b, c = faces.T
    return np.asarray((a == b) | (b == c) | (c == a))


def without_lines(mesh: Mesh) -> Mesh:
    """Return the mesh without faces that repeat a vertex, unless it has no others: no surface, but edges."""
    lines = repeats_vertex(mesh.faces)
    return Mesh(mesh.vertices, mesh.faces[~lines]) if lines.any() and not lines.all() else mesh


def without_repeated_faces(mesh: Mesh) -> Mesh:
    """Return the mesh with one face for each set of three vertices; exporters write each face twice, back and front."""
    if mesh.topology.edge_faces.counts.max() <= 2:
        return mesh
    first = np.unique(np.sort(mesh.faces, axis=1), axis=0, return_index=True)[1]
    return mesh if len(first) == len(mesh.faces) else Mesh(mesh.vertices, mesh.faces[np.sort(first)])


def part_of(mesh: Mesh, faces: NDArray[Any]) -> tuple[Mesh, NDArray[np.int32]]:
    """Return some faces of a mesh over the vertices that they use, and the numbers of these vertices, (k,)."""
    return compacted(mesh.vertices, mesh.faces[faces])


def compacted(vertices: NDArray[Any], faces: NDArray[np.int32]) -> tuple[Mesh, NDArray[np.int32]]:
    """Return a mesh of the vertices that faces use, and the numbers of these vertices, (k,)."""
    numbers, corners = np.unique(faces, return_inverse=True)
    return Mesh(vertices[numbers], corners.reshape(-1, 3)), numbers


def isolated(vertices: ArrayLike, faces: ArrayLike) -> Mesh:
    """Return the mesh without its bad faces; bad vertices, which no face uses any more, are at the origin.

    Parameters
    ----------
    vertices
        (n, 3) numbers.
    faces
        (m, 3) integers.

    Returns
    -------
    n vertices in their order, and the faces that are not bad in theirs

    Raises
    ------
    MeshError
        Wrong shape or type, or no face is left.
    """
    positions, corners = vertex_array(vertices), face_array(faces)
    left = corners[~bad_faces(positions, corners)]
    if len(corners) and not len(left):
        raise MeshError(
            f"none of the {len(corners)} faces is valid: each references a vertex that does not exist or is not "
            "finite, or repeats a vertex; export the mesh again"
        )
    return Mesh(np.where(bad_vertices(positions)[:, None], 0.0, positions), left)
