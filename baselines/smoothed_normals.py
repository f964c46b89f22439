"""Face normals after smoothing passes over the vertices."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Csr, Floats, Ints32, Mesh, Vectors, kernel, parallel_for, unit
from cascadenorm.mesh.vectors import add, cross, divided, length, row, scaled, subtract


def smoothed_normals(
    mesh: Mesh, along: Vectors | NDArray[np.float32], passes: tuple[int, ...], *, sigma_r: float = np.inf
) -> Iterator[NDArray[np.float32]]:
    """Smooth the vertices along fixed directions, and yield the face normals after each number of passes.

    In each pass, a vertex moves along its own normal to the mean height of itself and its neighbours (umbrella
    operator, Taubin 1995), so triangles keep their shape within the surface. Where a surface bends, the normal of a
    face depends on this shape, which averages of normals ignore.

    Parameters
    ----------
    mesh
        Mesh with m faces.
    along
        (m, 3) face normals that are smoother than those of the mesh. Vertices move along their area-weighted sums.
    passes
        Numbers of passes, ascending.
    sigma_r
        Spread of the chord between the directions of a vertex and of its neighbours, by which these are weighted;
        infinity gives all the same weight.

    Yields
    ------
    (m, 3) unit normals. A face without area keeps its normal. The next passes overwrite them.
    """
    directions = np.empty_like(mesh.vertices)
    single = np.ascontiguousarray(along, np.float32)  # one type, compiled once
    parallel_for(len(directions), _direction_range, mesh.topology.vertex_faces, mesh.areas, single, directions)
    directions = unit(directions)
    neighbors, spread = mesh.topology.vertex_neighbors, 0.5 / sigma_r**2
    positions, after = mesh.vertices.copy(), np.empty_like(mesh.vertices)
    normals = np.empty(mesh.faces.shape, np.float32)
    for done in range(1, passes[-1] + 1):
        parallel_for(len(positions), _smooth_range, positions, directions, neighbors, spread, after)
        positions, after = after, positions
        if done in passes:
            parallel_for(len(normals), _normal_range, positions, mesh.faces, mesh.face_normals, normals)
            yield normals


@kernel
def _direction_range(start: int, stop: int, around: Csr, areas: Floats, along: Vectors, out: Vectors) -> None:
    """Sum the area-weighted normals around each vertex, without the temporary array that numpy would need."""
    for i in range(start, stop):
        total = (0.0, 0.0, 0.0)
        for k in range(around.indptr[i], around.indptr[i + 1]):
            f = around.indices[k]
            total = add(total, scaled(areas[f], row(along, f)))
        out[i, 0], out[i, 1], out[i, 2] = total


@kernel
def _smooth_range(
    start: int, stop: int, positions: Vectors, directions: Vectors, neighbors: Csr, spread: float, after: Vectors
) -> None:
    """Smooth some vertices once; the weight (1 - u/8)^8 approximates e^-u."""
    for i in range(start, stop):
        # heights of the neighbours along the direction of the vertex, weighted by the chord between both directions
        height, total = 0.0, 1.0
        for k in range(neighbors.indptr[i], neighbors.indptr[i + 1]):
            j = neighbors.indices[k]
            rise, weight = 0.0, 1.0
            for d in range(3):
                rise += directions[i, d] * (positions[j, d] - positions[i, d])
            if spread > 0:
                chord = 0.0
                for d in range(3):
                    chord += (directions[j, d] - directions[i, d]) ** 2
                weight = max(0.0, 1.0 - 0.125 * spread * chord) ** 8
            height += weight * rise
            total += weight

        # the vertex moves to the mean height, in which its own height is 0 and has weight 1
        for d in range(3):
            after[i, d] = positions[i, d] + height / total * directions[i, d]


@kernel
def _normal_range(start: int, stop: int, at: Vectors, faces: Ints32, otherwise: Vectors, out: Vectors) -> None:
    """Compute the normals of some faces from vertex positions; faces without area get the `otherwise` normal."""
    for f in range(start, stop):
        a, b, c = row(at, faces[f, 0]), row(at, faces[f, 1]), row(at, faces[f, 2])
        normal = cross(subtract(b, a), subtract(c, a))
        size = length(normal)
        out[f, 0], out[f, 1], out[f, 2] = divided(normal, size) if size > 0 else row(otherwise, f)
