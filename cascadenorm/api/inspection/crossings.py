"""Detect self-intersections: faces that cross other faces of the same mesh."""

import numpy as np

from cascadenorm.compute.arrays import Bools, Floats, Ints, Vectors
from cascadenorm.geometry.nearest import LEAF_TRIANGLES, SurfaceTree
from cascadenorm.mesh import SMALLEST_COSTLY_CHUNK, Mesh, kernel, parallel_for, repeats, repeats_vertex
from cascadenorm.mesh.vectors import Vector, cross, dot, row, subtract

MOST_NEAR = 1000  # maximum number of faces that are tested against one face
DETERMINANT_ROUNDING = 1e-14  # determinants below this share of the product of the edge lengths count as zero


def crossing_faces(mesh: Mesh) -> Bools:
    """Return (m,) which faces cross another: an edge of one passes through the interior or the boundary of the other.

    Faces that only touch do not count, nor do coplanar overlapping faces and faces that share two vertices or
    positions. Vertices at the same position count as one. At most a thousand nearby faces are tested per face.
    """
    crossing, places = np.zeros(len(mesh.faces), bool), repeats(mesh.vertices)[1]
    proper = np.flatnonzero(~repeats_vertex(places[mesh.faces]))
    if len(proper):
        surface = SurfaceTree(Mesh(mesh.vertices, mesh.faces[proper]))
        order = proper[surface.order]
        named, found = np.ascontiguousarray(places[mesh.faces[order]]), np.empty(len(order), bool)
        arrays = surface.corners, named, surface.boxes, found
        parallel_for(len(order), _crossing, *arrays, smallest=SMALLEST_COSTLY_CHUNK)
        crossing[order] = found
    return crossing


@kernel
def _crossing(start: int, stop: int, corners: Floats, named: Ints, boxes: Floats, found: Bools) -> None:
    """Traverse the bounding volume hierarchy with each face until a face that it crosses is found."""
    first_leaf = len(boxes) // 2
    stack = np.empty(64, np.int64)
    lower, upper = np.empty(3), np.empty(3)
    for f in range(start, stop):
        for d in range(3):
            lower[d] = min(corners[f, 0, d], corners[f, 1, d], corners[f, 2, d])
            upper[d] = max(corners[f, 0, d], corners[f, 1, d], corners[f, 2, d])
        found[f] = False

        # depth-first traversal of the boxes that overlap the box of the face
        stack[0], top, near = 0, 1, 0
        while top > 0 and not found[f] and near < MOST_NEAR:
            top -= 1
            node = stack[top]
            if not _overlap(lower, upper, boxes[node]):
                continue
            if node < first_leaf:
                stack[top], stack[top + 1] = 2 * node + 2, 2 * node + 1
                top += 2
                continue
            first = (node - first_leaf) * LEAF_TRIANGLES
            for g in range(first, min(first + LEAF_TRIANGLES, len(corners))):
                near += 1
                if g != f and _cross(corners[f], named[f], corners[g], named[g]):
                    found[f] = True
                    break


@kernel
def _overlap(lower: Floats, upper: Floats, box: Floats) -> bool:
    apart = False
    for d in range(3):
        apart |= lower[d] > box[1, d] or upper[d] < box[0, d]
    return not apart


@kernel
def _cross(ours: Vectors, our_names: Ints, theirs: Vectors, their_names: Ints) -> bool:
    """Test whether two triangles cross; at a shared vertex, only the opposite edges can cross the other triangle."""
    shared = our_shared = their_shared = 0
    for i in range(3):
        for j in range(3):
            if our_names[i] == their_names[j]:
                shared, our_shared, their_shared = shared + 1, i, j
    if shared > 1:
        return False
    if shared == 1:
        i, j = our_shared, their_shared
        return _pierces(ours, i + 1, theirs) or _pierces(theirs, j + 1, ours)
    for i in range(3):  # noqa: SIM110, numba compiles no generators
        if _pierces(ours, i, theirs) or _pierces(theirs, i, ours):
            return True
    return False


@kernel
def _pierces(other: Vectors, side: int, triangle: Vectors) -> bool:
    """Test whether an edge of another triangle passes through a triangle, from one side of its plane to the other."""
    p, q = row(other, side % 3), row(other, (side + 1) % 3)
    a, b, c = row(triangle, 0), row(triangle, 1), row(triangle, 2)
    if _side(a, b, c, p) * _side(a, b, c, q) >= 0:
        return False
    u, v, w = _side(p, q, a, b), _side(p, q, b, c), _side(p, q, c, a)
    return (u >= 0 and v >= 0 and w >= 0) or (u <= 0 and v <= 0 and w <= 0)


@kernel
def _side(a: Vector, b: Vector, c: Vector, d: Vector) -> int:
    """Return the sign of the determinant of b - a, c - a, d - a; 0 if it is within rounding error."""
    u, v, w = subtract(b, a), subtract(c, a), subtract(d, a)
    determinant = dot(w, cross(u, v))
    size = _sum_of_sizes(u) * _sum_of_sizes(v) * _sum_of_sizes(w)
    if abs(determinant) <= DETERMINANT_ROUNDING * size:
        return 0
    return 1 if determinant > 0 else -1


@kernel
def _sum_of_sizes(u: Vector) -> float:
    return abs(u[0]) + abs(u[1]) + abs(u[2])
