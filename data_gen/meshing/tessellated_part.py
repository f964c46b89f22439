"""Triangles of a part, built from the faces of its CAD model.

Walls become strips between loops; planar faces and fans close them.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.data_gen.meshing.polygon_triangulation import triangulated
from cascadenorm.mesh import Floats, Mesh

Ring = NDArray[np.int64]  # vertices along a loop, counterclockwise seen from above, or from the end of a sweep


class PartBuilder:
    """A mesh under construction. Faces that share a loop share its vertices, so that the finished mesh is closed."""

    def __init__(self, *, delaunay: bool, rng: np.random.Generator) -> None:
        self._points: list[Floats] = []
        self._faces: list[NDArray[np.int64]] = []
        self._count = 0
        self._delaunay = delaunay
        self._rng = rng

    def ring(self, points: ArrayLike) -> Ring:
        """Add vertices, (k, 3)."""
        added = np.atleast_2d(np.asarray(points, np.float64))
        self._points.append(added)
        self._count += len(added)
        return np.arange(self._count - len(added), self._count)

    def wall(self, rings: Sequence[Ring]) -> None:
        """Join consecutive rings. If they lead upward, the normals point outward."""
        way = self._rng.integers(3)
        for lower, upper in pairwise(rings):
            if len(lower) == 1 or len(upper) == 1:
                self._fan(lower, upper)
            elif len(lower) == len(upper):
                self._strip(lower, upper, way=int(way))
            else:
                self._zipped(lower, upper)

    def face(self, outline: Ring, holes: Sequence[Ring] = (), inner: ArrayLike = (), *, up: bool = True) -> None:
        """Triangulate a face over the xy plane that faces up or down."""
        points = np.concatenate(self._points)[:, :2]
        loops = [outline, *(hole[::-1] for hole in holes)]
        triangles = triangulated(points, loops, inner=np.asarray(inner, np.int64).tolist(), delaunay=self._delaunay)
        self._faces.append(triangles if up else triangles[:, ::-1])

    def end(self, ring: Ring, frame: Floats, *, ahead: bool) -> None:
        """Close a loop in space by a planar face; `frame` (2, 3) spans its plane."""
        points = np.concatenate(self._points) @ frame.T
        triangles = triangulated(points, [ring], delaunay=self._delaunay)
        self._faces.append(triangles if ahead else triangles[:, ::-1])

    def mesh(self) -> Mesh:
        """Return the mesh built so far."""
        return Mesh(np.concatenate(self._points), np.concatenate(self._faces))

    def _fan(self, lower: Ring, upper: Ring) -> None:
        """Join a loop to an apex, which is a ring of one vertex."""
        loop = lower if len(upper) == 1 else upper
        ahead = np.roll(loop, -1)
        apex = np.full(len(loop), (upper if len(upper) == 1 else lower)[0])
        self._faces.append(np.stack([loop, ahead, apex] if len(upper) == 1 else [ahead, loop, apex], axis=1))

    def _strip(self, lower: Ring, upper: Ring, *, way: int) -> None:
        """Add two triangles per pair of sides. The diagonals run all one way, all the other way, or alternate."""
        a, b, c, d = lower, np.roll(lower, -1), np.roll(upper, -1), upper
        first = np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1)
        other = np.stack([np.stack([a, b, d], axis=1), np.stack([b, c, d], axis=1)], axis=1)
        pick = np.arange(len(a)) % 2 == 1 if way == 2 else np.full(len(a), way == 1)
        self._faces.append(np.where(pick[:, None, None], other, first).reshape(-1, 3))

    def _zipped(self, lower: Ring, upper: Ring) -> None:
        """Join loops with different numbers of vertices, both evenly spaced in angle and with the same start."""
        i = k = 0
        faces = []
        while i < len(lower) or k < len(upper):
            a, d = lower[i % len(lower)], upper[k % len(upper)]
            if k == len(upper) or (i < len(lower) and (i + 1) * len(upper) <= (k + 1) * len(lower)):
                i += 1
                faces.append((a, lower[i % len(lower)], d))
            else:
                k += 1
                faces.append((a, upper[k % len(upper)], d))
        self._faces.append(np.array(faces, np.int64))
