"""Exact nearest-point queries on a surface with a bounding volume hierarchy."""

from typing import NamedTuple

import numpy as np

from cascadenorm.mesh import SMALLEST_COSTLY_CHUNK, Floats, Ints, Mesh, Vectors, kernel, parallel_for
from cascadenorm.mesh.ordering import morton_codes
from cascadenorm.mesh.vectors import Vector, cross, dot, row, subtract

LEAF_TRIANGLES = 4  # triangles in a leaf box


class Nearest(NamedTuple):
    """The distance of each point to the surface, and a face with the nearest point."""

    distances: Floats
    faces: Ints


class SurfaceTree:
    """A complete binary tree of bounding boxes over the m triangles of a mesh, sorted along a space-filling curve.

    `order`, (m,), are the faces in the order of the curve, and `corners`, (m, 3, 3), their positions; a face without
    area counts as a segment or a point. `boxes`, (b, 2, 3), are the lower and upper corners of the boxes. Node i has
    the children 2i + 1 and 2i + 2. The last (b + 1) / 2 boxes are the leaves, with up to LEAF_TRIANGLES faces each.
    """

    def __init__(self, mesh: Mesh) -> None:
        self.order = np.argsort(morton_codes(mesh.centroids), kind="stable")
        self.corners = mesh.corners[self.order]
        leaves = 1 << ((len(self.corners) - 1) // LEAF_TRIANGLES).bit_length()
        self.boxes = np.empty((2 * leaves - 1, 2, 3))
        lowest = self.boxes[leaves - 1 :]
        lowest[:, 0], lowest[:, 1] = np.inf, -np.inf
        starts = np.arange(0, len(self.corners), LEAF_TRIANGLES)
        lowest[: len(starts), 0] = np.minimum.reduceat(self.corners.min(axis=1), starts)
        lowest[: len(starts), 1] = np.maximum.reduceat(self.corners.max(axis=1), starts)
        while leaves > 1:
            leaves //= 2
            children = self.boxes[2 * leaves - 1 : 4 * leaves - 1].reshape(-1, 2, 2, 3)
            self.boxes[leaves - 1 : 2 * leaves - 1, 0] = children[:, :, 0].min(axis=1)
            self.boxes[leaves - 1 : 2 * leaves - 1, 1] = children[:, :, 1].max(axis=1)

    def nearest(self, points: Vectors) -> Nearest:
        """Find the distance and nearest face for each point, (k, 3); ties go to the lowest face index."""
        points = np.ascontiguousarray(points, np.float64)
        squared, faces = np.empty(len(points)), np.empty(len(points), np.int64)
        arrays = points, self.corners, self.order, self.boxes, squared, faces
        parallel_for(len(points), _search, *arrays, smallest=SMALLEST_COSTLY_CHUNK)
        return Nearest(np.sqrt(squared), faces)


@kernel
def _search(
    start: int, stop: int, points: Vectors, corners: Floats, order: Ints, boxes: Floats, squared: Floats, faces: Ints
) -> None:
    """Traverse the tree, nearer child first, skipping boxes farther than the best triangle so far."""
    first_leaf = len(boxes) // 2
    stack, away = np.empty(64, np.int64), np.empty(64)  # boxes to visit, and their squared distances
    for i in range(start, stop):
        p = row(points, i)
        best, face = np.inf, -1
        stack[0], away[0], top = 0, 0.0, 1
        while top > 0:
            top -= 1
            node = stack[top]
            if away[top] > best:
                continue
            # inner node: push the nearer child last, so that it is visited first
            if node < first_leaf:
                near, far = 2 * node + 1, 2 * node + 2
                to_near, to_far = _box_distance2(p, boxes, near), _box_distance2(p, boxes, far)
                if to_far < to_near:
                    near, far, to_near, to_far = far, near, to_far, to_near
                stack[top], away[top] = far, to_far
                stack[top + 1], away[top + 1] = near, to_near
                top += 2
                continue
            # leaf: ties go to the lowest face index
            first = (node - first_leaf) * LEAF_TRIANGLES
            for t in range(first, min(first + LEAF_TRIANGLES, len(corners))):
                distance = _triangle_distance2(p, corners[t])
                if distance < best or (distance == best and order[t] < face):
                    best, face = distance, order[t]
        squared[i], faces[i] = best, face


@kernel
def _box_distance2(p: Vector, boxes: Floats, node: int) -> float:
    total = 0.0
    for d in range(3):
        outside = max(boxes[node, 0, d] - p[d], p[d] - boxes[node, 1, d], 0.0)
        total += outside * outside
    return total


@kernel
def _triangle_distance2(p: Vector, corner: Vectors) -> float:
    """Return the squared distance to the plane if the foot is inside the triangle, else to the nearest side."""
    a, b, c = subtract(row(corner, 0), p), subtract(row(corner, 1), p), subtract(row(corner, 2), p)
    normal = cross(subtract(b, a), subtract(c, a))
    length2 = dot(normal, normal)
    inside = dot(cross(a, b), normal) >= 0 and dot(cross(b, c), normal) >= 0 and dot(cross(c, a), normal) >= 0
    if length2 > 0 and inside:
        height = dot(a, normal)
        return height * height / length2
    return min(_side_distance2(a, b), _side_distance2(b, c), _side_distance2(c, a))


@kernel
def _side_distance2(a: Vector, b: Vector) -> float:
    """Return the squared distance of the origin to the segment from a to b."""
    along = subtract(b, a)
    length2 = dot(along, along)
    t = min(max(-dot(a, along) / length2, 0.0), 1.0) if length2 > 0 else 0.0
    foot = (a[0] + t * along[0], a[1] + t * along[1], a[2] + t * along[2])
    return dot(foot, foot)
