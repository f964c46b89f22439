"""Creases: edges across which a method must not mix. The mesh is cut along them, and its sides are joined again."""

import numbers
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.mesh import Mesh, Vectors, first_places, row_sums
from cascadenorm.registry import ParameterError

HOLD = 0.02  # of a joined vertex to the mean of its copies; against 1 - cos of the angle between two sides


class Sides(NamedTuple):
    """A mesh cut along its creases, with a copy of a vertex for each side that meets there.

    Parameters
    ----------
    mesh : k vertices, the first n those of the mesh that was cut; its faces in their order
    owners : (k,) the vertex that each of them is a copy of; 0 … n - 1 come first
    """

    mesh: Mesh
    owners: NDArray[np.int64]

    def of(self, mesh: Mesh) -> Mesh:
        """Return the mesh that was cut, with its vertices elsewhere, cut in the same way."""
        return self.mesh.moved(mesh.vertices[self.owners])

    def joined(self, mesh: Mesh, vertices: Vectors) -> Vectors:
        """Bring the copies of a vertex together where their sides meet.

        Each side says where its tangent plane is, so the vertex goes where it is nearest to these planes, and, as far
        as they leave it free, to the mean of the copies: it minimises Σ <n_c, x - x_c>² + h |x - mean of x_c|².

        Parameters
        ----------
        mesh : n vertices before they moved
        vertices : (k, 3) where each copy went

        Returns
        -------
        (n, 3); copies that moved alike keep their move
        """
        count = len(mesh.vertices)
        split = np.zeros(count, bool)
        split[self.owners[count:]] = True
        chosen = np.flatnonzero(split[self.owners])
        places, row = np.unique(self.owners[chosen], return_inverse=True)
        moves = vertices[chosen] - mesh.vertices[self.owners[chosen]]
        mean = row_sums(row, moves) / np.bincount(row)[:, None]
        normals = self.mesh.moved(vertices).vertex_normals[chosen]
        missing = np.einsum("ij,ij->i", normals, moves - mean[row])
        planes = row_sums(row, (normals[:, :, None] * normals[:, None, :]).reshape(-1, 9)).reshape(-1, 3, 3)
        right = row_sums(row, normals * missing[:, None])[:, :, None]
        joined = vertices[:count].copy()
        joined[places] = mesh.vertices[places] + mean + np.linalg.solve(planes + HOLD * np.eye(3), right)[:, :, 0]
        return joined


def crease_edges(mesh: Mesh, creases: float | ArrayLike) -> NDArray[np.bool_]:
    """Return which edges of the mesh are creases.

    Parameters
    ----------
    mesh : its edges with two faces have an angle between their normals, however these run; faces without area have none
    creases : that angle in degrees, and sharper edges are creases; or (k, 2) pairs of vertices that edges join

    Raises
    ------
    ParameterError : an angle out of 0 … 180, or pairs that are no edges
    """
    if isinstance(creases, numbers.Real) and not isinstance(creases, bool):
        if not 0 <= creases <= 180:
            raise ParameterError(f"creases is {creases!r}; an angle in degrees must be within 0 … 180")
        return _turns(mesh) > np.radians(float(creases))
    pairs = np.asarray(creases)
    return _given(mesh, pairs if pairs.size else np.zeros((0, 2), np.int64))


def _turns(mesh: Mesh) -> NDArray[np.float64]:
    """(e,) angle between the two faces of each edge, 0 where there are not two."""
    topology = mesh.topology
    first, second = mesh.normals[topology.face_pairs.T]
    alike = topology.balance[topology.interior_edges] != 0  # both faces run along the edge the same way
    second = np.where(alike[:, None], -second, second)
    angles = np.zeros(len(topology.edges))
    chords = np.linalg.norm(first - second, axis=1)
    known = (first.any(axis=1)) & (second.any(axis=1))
    angles[topology.interior_edges] = np.where(known, 2 * np.arcsin(np.minimum(chords / 2, 1)), 0.0)
    return angles


def _given(mesh: Mesh, pairs: NDArray[Any]) -> NDArray[np.bool_]:
    if pairs.ndim != 2 or pairs.shape[1] != 2 or pairs.dtype.kind not in "iu":
        raise ParameterError(
            f"creases have shape {pairs.shape} and type {pairs.dtype}; they must be an angle in degrees, or (k, 2) "
            "numbers of the vertices that each crease joins"
        )
    count, edges = len(mesh.vertices), mesh.topology.edges.astype(np.int64)
    low, high = np.sort(pairs.astype(np.int64), axis=1).T
    keys = edges[:, 0] * count + edges[:, 1]
    place = np.minimum(np.searchsorted(keys, low * count + high), len(keys) - 1)
    bad = (edges[place, 0] != low) | (edges[place, 1] != high)
    if bad.any():
        named = "-".join(map(str, pairs[bad][0]))
        raise ParameterError(
            f"{bad.sum()} of {len(bad)} creases are no edges of the mesh (rows {first_places(bad)}; the first is "
            f"{named}): give the two vertices of an edge, counted from 0"
        )
    creases = np.zeros(len(edges), bool)
    creases[place] = True
    return creases


def cut(mesh: Mesh, creases: NDArray[np.bool_]) -> Sides:
    """Cut a mesh along creases; corners at a vertex stay together where faces hang together by other edges.

    Parameters
    ----------
    mesh : n vertices; vertices that no crease touches stay whole
    creases : (e,) for each edge; where they end within the surface, nothing is cut
    """
    count, faces = len(mesh.vertices), mesh.faces
    touched = np.zeros(count, bool)
    touched[mesh.topology.edges[creases]] = True
    corners = np.flatnonzero(touched[faces.ravel()])
    vertices = faces.ravel()[corners]
    fans = mesh.topology.fans(~creases)
    copies, copy = np.unique(vertices.astype(np.int64) * faces.size + fans[corners], return_inverse=True)
    owners = copies // faces.size
    further = np.concatenate([[False], owners[1:] == owners[:-1]])[: len(owners)]
    numbers = np.where(further, count - 1 + np.cumsum(further), owners)
    cut_faces = faces.ravel().astype(np.int64)
    cut_faces[corners] = numbers[copy]
    owners = np.concatenate([np.arange(count), owners[further]])
    if not further.any():
        return Sides(mesh, owners)
    return Sides(Mesh(mesh.vertices[owners], cut_faces.reshape(-1, 3)), owners)
