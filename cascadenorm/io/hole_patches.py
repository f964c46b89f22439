"""Vertices and triangles that close holes of a file, and their values."""

from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from cascadenorm.io.base import MeshFile
from cascadenorm.io.content import Positions
from cascadenorm.mesh import Mesh, connected_components, one_blas_thread


class HolePatches:
    """Vertices and triangles that close the holes of a file, with k positions and p polygons.

    They are the vertices and faces that a filled mesh of the file has after the file's own: `positions`, (a, 3) in the
    type of the file, and `triangles`, (b, 3) rows of the positions of the file, followed by the additional ones. If the
    file splits a vertex, its first copy is used. `polygons`, (b,), are the nearest polygons of the file, counted in
    edges, from which the triangles take their values, and `parts`, (b,), the hole that each closes. `left_out` are
    properties of the surroundings that the patches lack, in words; code that adds patches to a file appends to it.
    """

    def __init__(self, file: MeshFile, filled: Mesh) -> None:
        self._filled, self._own, self.left_out = filled, len(file.mesh.vertices), list[str]()
        self._first = np.unique(file.welds, return_index=True)[1]
        count, faces = len(file.positions), len(file.mesh.faces)
        further = count + np.arange(len(filled.vertices) - self._own)
        self.positions: Positions = filled.vertices[self._own :].astype(file.positions.dtype)
        self.triangles: NDArray[np.int64] = np.concatenate([self._first, further])[filled.faces[faces:]]
        beside = np.argsort(filled.topology.face_edges, axis=None, kind="stable")
        same = np.diff(filled.topology.face_edges.ravel()[beside]) == 0
        pairs = np.stack([beside[:-1][same], beside[1:][same]], axis=1) // 3
        inside = pairs[(pairs >= faces).all(axis=1)] - faces
        self.parts = connected_components(inside, len(self.triangles))
        self.polygons = file.triangle_polygons[_nearest(faces, len(filled.faces), pairs)]
        self._nearest = _nearest(self._own, len(filled.vertices), filled.topology.edges)

    def nearest(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return (a,) values of the nearest vertex of the file, counted in edges, from values (k,)."""
        return values[self._first[self._nearest]]

    def blended(self, values: NDArray[Any]) -> NDArray[np.float64]:
        """Return (a,) values that equal the mean of their neighbours, or the nearest values if some are not finite."""
        known = values[self._first].astype(np.float64)
        if not len(self.positions) or not np.isfinite(known).all():
            return self.nearest(values).astype(np.float64)
        count, (i, j) = len(self._filled.vertices), self._filled.topology.edges.T
        graph = scipy.sparse.coo_array((np.ones(2 * len(i)), (np.r_[i, j], np.r_[j, i])), (count, count)).tocsr()
        rows = graph[self._own :]
        matrix = scipy.sparse.diags_array(rows.sum(axis=1)) - rows[:, self._own :]
        with one_blas_thread(scipy.sparse.linalg):
            return np.asarray(scipy.sparse.linalg.spsolve(matrix.tocsc(), rows[:, : self._own] @ known), np.float64)

    def all_normals(self, stored: NDArray[Any]) -> NDArray[np.float64]:
        """Return (k + a, 3) unit normals of first copies, zero for other copies, and of additional vertices.

        They are oriented like the normals of the file, (k, 3).
        """
        normals = self._filled.vertex_normals
        signed = normals * _side(stored[self._first], normals[: self._own])
        of_file = np.zeros((len(stored), 3))
        of_file[self._first] = signed[: self._own]
        return np.concatenate([of_file, signed[self._own :]])

    def face_normals(self, stored: NDArray[Any]) -> NDArray[np.float64]:
        """Return (b, 3) unit normals of the triangles, oriented like those of the polygons, (p, 3)."""
        normals = self._filled.face_normals[-len(self.triangles) :]
        return normals * _side(stored[self.polygons], normals)


def _nearest(own: int, count: int, pairs: NDArray[np.integer]) -> NDArray[np.int64]:
    """Return for each index from `own` on the nearest index below `own`, along pairs of neighbours."""
    nearest = np.where(np.arange(count) < own, np.arange(count), -1)
    ends = np.concatenate([pairs, pairs[:, ::-1]])
    while (nearest < 0).any():
        told, asking = ends[(nearest[ends[:, 0]] >= 0) & (nearest[ends[:, 1]] < 0)].T
        assert len(asking), "a patch is connected with what is around it"
        nearest[asking] = nearest[told]
    return nearest[own:]


def _side(stored: NDArray[Any], normals: NDArray[np.float64]) -> float:
    """Return 1 if most stored normals point to the same side as the others, else -1."""
    with np.errstate(invalid="ignore"):
        return -1.0 if np.nansum(np.sign((stored * normals).sum(axis=1))) < 0 else 1.0
