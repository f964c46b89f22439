"""Refinement of hole patches with Delaunay edge flips (Liepa 2003)."""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Bools, Floats, Ints, Ints32, Vectors

DENSITY = 2**0.5  # Liepa's α: larger values give more vertices
MOST_ROUNDS = 60  # of splits, and of flips after each; regular patches never reach this bound

Faces = Ints32


def refine(vertices: Vectors, faces: Faces, scale: Floats, taken: Ints) -> tuple[Vectors, Faces]:
    """Split the triangles of a patch at their centroids until its edges are about as long as those around it.

    The scale, (n,), is the target edge length around each of the (n, 3) vertices of the whole mesh; new vertices get
    the mean of the corners. The boundary edges of the (k, 3) faces are kept, and edges that the rest of the mesh has
    `taken`, (e, 2), are not created again. Returns the (n + new, 3) vertices, the given ones first, and the (k + 2 new,
    3) faces of the patch.
    """
    faces = _flipped(vertices, faces, taken)
    for _ in range(MOST_ROUNDS):
        centers, wanted = vertices[faces].mean(axis=1), scale[faces].mean(axis=1)
        reach = DENSITY * np.linalg.norm(vertices[faces] - centers[:, None], axis=2).min(axis=1)
        split = reach > np.maximum(wanted, scale[faces].max(axis=1))
        if not split.any():
            break
        new = np.arange(len(vertices), len(vertices) + split.sum(), dtype=np.int32)
        a, b, c = faces[split].T
        vertices, scale = np.concatenate([vertices, centers[split]]), np.concatenate([scale, wanted[split]])
        parts = [np.stack(corners, axis=1) for corners in ((a, b, new), (b, c, new), (c, a, new))]
        faces = _flipped(vertices, np.concatenate([faces[~split], *parts]), taken)
    return vertices, faces


def _flipped(vertices: Vectors, faces: Faces, taken: Ints) -> Faces:
    """Flip interior edges of the patch until the sum of their two opposite angles is at most 180°."""
    n = len(vertices)
    taken_keys = _keys(taken, n)
    for _ in range(MOST_ROUNDS):
        sides = np.stack([faces, np.roll(faces, -1, axis=1), np.roll(faces, 1, axis=1)], axis=2).reshape(-1, 3)
        keys = _keys(sides[:, :2], n)
        order = np.argsort(keys, kind="stable")
        same = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
        first, second = order[same], order[same + 1]
        (a, b, c), d = sides[first].T, sides[second, 2]
        angles = _angle(vertices, c, a, b) + _angle(vertices, d, a, b)
        crossing = np.sort(np.stack([c, d], axis=1).astype(np.int64), axis=1)
        opposed = sides[first, 0] == sides[second, 1]  # the two faces traverse the edge in opposite directions
        free = ~np.isin(_keys(crossing, n), np.concatenate([keys, taken_keys])) & (c != d)
        wanted = (angles > np.pi + 1e-6) & opposed & free & _stays_upright(vertices, a, b, c, d)
        if not wanted.any():
            break
        faces = faces.copy()
        touched, made = np.zeros(len(faces), bool), set()
        for edge in np.flatnonzero(wanted)[np.argsort(-angles[wanted], kind="stable")]:
            f, g = first[edge] // 3, second[edge] // 3
            ends = (crossing[edge, 0], crossing[edge, 1])
            if touched[f] or touched[g] or ends in made:
                continue
            touched[f] = touched[g] = True
            made.add(ends)
            faces[f], faces[g] = (c[edge], d[edge], b[edge]), (d[edge], c[edge], a[edge])
    return faces


def _keys(edges: NDArray[np.integer], n: int) -> Ints:
    """Return a unique number for each undirected edge."""
    low, high = edges.min(axis=1).astype(np.int64), edges.max(axis=1)
    return np.asarray(low * n + high, np.int64)


def _angle(vertices: Vectors, at: Faces, a: Faces, b: Faces) -> Floats:
    u, v = vertices[a] - vertices[at], vertices[b] - vertices[at]
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(axis=1)))


def _stays_upright(vertices: Vectors, a: Faces, b: Faces, c: Faces, d: Faces) -> Bools:
    """Return whether the two new faces have the orientation of the two old ones."""

    def area(i: Faces, j: Faces, k: Faces) -> Vectors:
        return np.cross(vertices[j] - vertices[i], vertices[k] - vertices[i])

    old = area(a, b, c) + area(b, a, d)
    return np.asarray(((area(c, d, b) * old).sum(axis=1) > 0) & ((area(d, c, a) * old).sum(axis=1) > 0))
