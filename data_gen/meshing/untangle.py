"""Make a polygonised surface a manifold where sheets touch.

Edges and vertices that sheets share are duplicated.
"""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Mesh, Vectors


def untangled(mesh: Mesh) -> Mesh:
    """Give each pair of faces at an edge with four faces its own edge, and each fan of faces its own vertex."""
    vertices, faces = _with_single_edges(mesh)
    return _with_single_fans(Mesh(vertices, faces))


def _with_single_edges(mesh: Mesh) -> tuple[Vectors, NDArray[np.int32]]:
    """Insert a new vertex for each pair of faces on edges with four faces.

    The pairs are the faces with the closest centroids, and their vertex is slightly displaced towards them.
    """
    edge_faces = mesh.topology.edge_faces
    crowded = np.flatnonzero(edge_faces.counts == 4)
    if len(crowded) == 0:
        return mesh.vertices, mesh.faces
    fresh: list[NDArray[np.float64]] = []
    inserted: dict[int, list[tuple[int, int]]] = {}  # face: (side, vertex)
    for edge in crowded.tolist():
        a, b = mesh.topology.edges[edge]
        members = edge_faces.row(edge)
        sides = [int(np.flatnonzero(mesh.topology.face_edges[f] == edge)[0]) for f in members]
        ahead = [k for k in range(4) if mesh.faces[members[k], sides[k]] == a]
        back = [k for k in range(4) if k not in ahead]
        if len(ahead) != 2:
            continue
        middle = mesh.centroids[members]
        gap = np.linalg.norm(middle[ahead][:, None] - middle[back][None], axis=2)
        if gap[0, 0] + gap[1, 1] > gap[0, 1] + gap[1, 0]:
            back.reverse()
        for pair in zip(ahead, back, strict=True):
            place = 0.5 * (mesh.vertices[a] + mesh.vertices[b])
            place = place + 0.15 * (middle[list(pair)].mean(axis=0) - place)
            for k in pair:
                inserted.setdefault(int(members[k]), []).append((sides[k], len(mesh.vertices) + len(fresh)))
            fresh.append(place)
    kept = np.delete(mesh.faces, list(inserted), axis=0)
    pieces = [triangle for f, marks in inserted.items() for triangle in _pieces(mesh.faces[f], dict(marks))]
    if not pieces:
        return mesh.vertices, mesh.faces
    return np.concatenate([mesh.vertices, fresh]), np.concatenate([kept, np.array(pieces, np.int32)])


def _pieces(face: NDArray[np.int32], marks: dict[int, int]) -> list[tuple[int, int, int]]:
    """Split a triangle that has new vertices on one, two or three of its sides."""
    outline: list[int] = []
    for side in range(3):
        outline.append(int(face[side]))
        if side in marks:
            outline.append(marks[side])
    new = set(marks.values())
    triangles = []
    while len(outline) > 3:  # clip an old corner between two vertices, at least one of which is new
        k = next(
            i
            for i in range(len(outline))
            if outline[i] not in new and (outline[i - 1] in new or outline[(i + 1) % len(outline)] in new)
        )
        triangles.append((outline[k - 1], outline[k], outline[(k + 1) % len(outline)]))
        del outline[k]
    return [*triangles, (outline[0], outline[1], outline[2])]


def _with_single_fans(mesh: Mesh) -> Mesh:
    """Give each fan of faces at a vertex its own vertex; a fan is connected across edges with two faces."""
    fan = mesh.topology.fans(mesh.topology.edge_faces.counts == 2)
    vertices = np.empty((fan.max() + 1, 3))
    vertices[fan] = mesh.vertices[mesh.faces.ravel()]
    return Mesh(vertices, fan.reshape(-1, 3))
