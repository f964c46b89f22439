"""Detection and removal of invalid vertices and faces."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.compute.arrays import Bools, Ints32, Vectors, all_in_rows, any_in_rows
from cascadenorm.compute.equal_rows import repeats
from cascadenorm.errors import MeshError
from cascadenorm.mesh.mesh import Mesh, face_array, vertex_array


def bad_vertices(vertices: ArrayLike) -> Bools:
    """Return (n,) whether each vertex is not finite."""
    return ~all_in_rows(np.isfinite(vertex_array(vertices)))


def bad_faces(vertices: ArrayLike, faces: ArrayLike) -> Bools:
    """Return (m,) whether each face repeats a vertex or references one that is not finite or does not exist."""
    corners, bad = face_array(faces), bad_vertices(vertices)
    out_of_range = (corners < 0) | (corners >= len(bad))
    touching = any_in_rows(np.append(bad, True)[np.where(out_of_range, len(bad), corners)])
    return touching | repeats_vertex(corners)


def repeats_vertex(faces: NDArray[Any]) -> Bools:
    """Return (m,) whether each of the faces, (m, 3), repeats a vertex."""
    a, b, c = faces.T
    return np.asarray((a == b) | (b == c) | (c == a))


def without_lines(mesh: Mesh) -> Mesh:
    """Remove faces that repeat a vertex, unless all faces do: such a mesh has edges but no surface."""
    lines = repeats_vertex(mesh.faces)
    return Mesh(mesh.vertices, mesh.faces[~lines]) if lines.any() and not lines.all() else mesh


def without_repeated_faces(mesh: Mesh) -> Mesh:
    """Keep one face for each set of three vertices; some exporters write a front and a back face."""
    if mesh.topology.edge_faces.counts.max() <= 2:
        return mesh
    repeated = repeats(np.sort(mesh.faces, axis=1))[0]
    return Mesh(mesh.vertices, mesh.faces[~repeated]) if repeated.any() else mesh


def surface_of(mesh: Mesh) -> Mesh:
    """Remove faces that repeat a vertex (see `without_lines`) or another face, whose normals may cancel."""
    return without_repeated_faces(without_lines(mesh))


def part_of(mesh: Mesh, faces: NDArray[Any]) -> tuple[Mesh, Ints32]:
    """Return the submesh of some faces, and the numbers of its vertices in the mesh, (k,)."""
    return compacted(mesh.vertices, mesh.faces[faces])


def with_part_moved(mesh: Mesh, faces: Bools, moved: Callable[..., Vectors], *others: NDArray[Any]) -> Vectors:
    """Return the vertices of a mesh, (n, 3), of which a function moves those of the given faces, whole components.

    The function is called with the part of these faces, and with its rows of other arrays, (n, …).
    """
    if faces.all():
        return moved(mesh, *others)
    vertices = mesh.vertices.copy()
    if faces.any():
        part, numbers = part_of(mesh, faces)
        vertices[numbers] = moved(part, *(rows[numbers] for rows in others))
    return vertices


def compacted(vertices: NDArray[Any], faces: Ints32) -> tuple[Mesh, Ints32]:
    """Return the mesh of the vertices that the faces reference, and the numbers of these vertices, (k,)."""
    numbers, corners = np.unique(faces, return_inverse=True)
    return Mesh(vertices[numbers], corners.reshape(-1, 3)), numbers


def isolated(vertices: ArrayLike, faces: ArrayLike) -> Mesh:
    """Return the mesh of all vertices and the valid faces, in their order; invalid vertices are moved to the origin.

    Raises MeshError if the arrays have a wrong shape or type, or no valid face is left.
    """
    positions, corners = vertex_array(vertices), face_array(faces)
    left = corners[~bad_faces(positions, corners)]
    if len(corners) and not len(left):
        raise MeshError(
            f"none of the {len(corners)} faces is valid: each references a vertex that does not exist or is not "
            "finite, or repeats a vertex; export the mesh again"
        )
    return Mesh(np.where(bad_vertices(positions)[:, None], 0.0, positions), left)
