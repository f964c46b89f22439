"""Cut meshes along creases and rejoin the sides.

Creases are edges across which a method must not average.
"""

import numbers
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.errors import ParameterError
from cascadenorm.mesh import Bools, Floats, Ints, Ints32, Mesh, Vectors, first_places, marked, scatter_add

MEAN_WEIGHT = 0.02  # weight h of the mean of the copies, relative to 1 - cos of the angle between two sides


class CreaseSides(NamedTuple):
    """A mesh cut along its creases, with one copy of a vertex for each side that meets there."""

    mesh: Mesh  # with k vertices, the first n of which are those of the original mesh; faces keep their order
    owners: Ints  # (k,) original vertex of each copy, starting with 0 … n - 1

    def of(self, mesh: Mesh) -> Mesh:
        """Cut the original mesh with new positions in the same way."""
        return self.mesh.moved(mesh.vertices[self.owners])

    def joined(self, mesh: Mesh, vertices: Vectors) -> Vectors:
        """Join the copies of each vertex, (k, 3), where the tangent planes of their sides intersect.

        A copy c at x_c with normal n_c determines the tangent plane of its side. The joined vertex x minimizes Σ <n_c,
        x - x_c>² + h |x - mean of x_c|². The second term keeps x near the mean where the planes leave it free. `mesh`
        is the original mesh before its vertices moved. If all copies have the same displacement, the joined vertex
        keeps it. Returns (n, 3) vertices.
        """
        # Copies of the vertices that have several, and for each copy the row of its vertex in `places`
        count = len(mesh.vertices)
        split = marked(self.owners[count:], count)
        chosen = np.flatnonzero(split[self.owners])
        places, row = np.unique(self.owners[chosen], return_inverse=True)

        # Displacements, their mean, and the distance of each plane from the mean along its normal
        moves = vertices[chosen] - mesh.vertices[self.owners[chosen]]
        mean = scatter_add(row, moves, len(places)) / np.bincount(row)[:, None]
        normals = self.mesh.moved(vertices).vertex_normals[chosen]
        residuals = np.einsum("ij,ij->i", normals, moves - mean[row])

        # Normal equations: (Σ n_c n_cᵀ + h I) (x - mean) = Σ <n_c, x_c - mean> n_c
        planes = scatter_add(row, normals[:, :, None] * normals[:, None, :], len(places))
        right = scatter_add(row, normals * residuals[:, None], len(places))[:, :, None]
        joined = vertices[:count].copy()
        offsets = np.linalg.solve(planes + MEAN_WEIGHT * np.eye(3), right)[:, :, 0]
        joined[places] = mesh.vertices[places] + mean + offsets
        return joined


def crease_edges(mesh: Mesh, creases: float | ArrayLike, places: Ints32 | None = None) -> Bools:
    """Return (e,) bool, whether each edge of the mesh is a crease.

    `creases` is an angle in degrees, which selects the edges whose two face normals differ by more than that, or (k, 2)
    vertex indices of edges. Faces may have any orientation, and edges of faces without area have no angle. `places`,
    (n,), is the mesh vertex of each vertex index in `creases`; None means that they are equal. Raises ParameterError if
    an angle is outside 0 … 180, or a pair is not an edge.
    """
    if isinstance(creases, np.ndarray) and creases.ndim == 0:
        creases = creases.item()
    if isinstance(creases, numbers.Real) and not isinstance(creases, bool):
        if not 0 <= creases <= 180:
            raise ParameterError(f"is {creases!r}; an angle in degrees must be within 0 … 180", parameter="creases")
        return _angles(mesh) > np.radians(float(creases))
    pairs = np.asarray(creases)
    return _listed_edges(mesh, pairs if pairs.size else np.zeros((0, 2), np.int64), places)


def renumbered_creases(creases: Any, numbers: NDArray[np.integer[Any]]) -> Any:
    """Return creases over a mesh as creases over another one, with a new index of each vertex, -1 if it is left out.

    Pairs of vertices of which one is left out are dropped. An angle stays as it is, and so do vertices that do not
    exist, which `crease_edges` rejects.
    """
    pairs = np.asarray(creases)
    if pairs.ndim != 2 or pairs.dtype.kind not in "iu":
        return creases
    exist = (pairs >= 0) & (pairs < len(numbers))
    pairs = pairs.astype(np.int64)
    found = np.where(exist, numbers[np.where(exist, pairs, 0)], pairs)
    return found[(~exist | (found >= 0)).all(axis=1)]


def _angles(mesh: Mesh) -> Floats:
    """Return (e,) angles between the normals of the two faces of each edge; 0 for edges without exactly two faces."""
    topology = mesh.topology
    first, second = mesh.face_normals[topology.face_pairs.T]
    inconsistent = topology.balance[topology.interior_edges] != 0  # both faces traverse the edge in the same direction
    second = np.where(inconsistent[:, None], -second, second)
    angles = np.zeros(len(topology.edges))
    chords = np.linalg.norm(first - second, axis=1)
    known = (first.any(axis=1)) & (second.any(axis=1))
    angles[topology.interior_edges] = np.where(known, 2 * np.arcsin(np.minimum(chords / 2, 1)), 0.0)
    return angles


def _listed_edges(mesh: Mesh, pairs: NDArray[Any], places: Ints32 | None) -> Bools:
    """Return (e,) bool, whether each edge joins one of the given pairs of vertices."""
    if pairs.ndim != 2 or pairs.shape[1] != 2 or pairs.dtype.kind not in "iu":
        raise ParameterError(
            f"has shape {pairs.shape} and type {pairs.dtype}; it must be an angle in degrees, or (k, 2) vertex indices "
            "of edges",
            parameter="creases",
        )
    # Edges are sorted by their vertices, so a single key finds each pair
    count, edges = len(mesh.vertices), mesh.topology.edges.astype(np.int64)
    within = (pairs >= 0) & (pairs < count)
    ends = np.where(within, pairs, -1).astype(np.int64)
    if places is not None:
        ends = np.where(within, places[ends], -1).astype(np.int64)
    low, high = np.sort(ends, axis=1).T
    keys = edges[:, 0] * count + edges[:, 1]
    place = np.minimum(np.searchsorted(keys, low * count + high), len(keys) - 1)
    bad = (edges[place, 0] != low) | (edges[place, 1] != high)
    if bad.any():
        first = "-".join(map(str, pairs[bad][0]))
        raise ParameterError(
            f"has {bad.sum()} of {len(bad)} pairs that are not edges of the mesh (rows {first_places(bad)}; the first "
            f"is {first})",
            parameter="creases",
            hint="give the two vertices of an edge, counted from 0",
        )
    return marked(place, len(edges))


def cut_along(mesh: Mesh, creases: Bools) -> CreaseSides:
    """Cut a mesh along creases, (e,) bool; faces at a vertex share a copy if other edges connect them.

    Vertices that no crease touches stay whole. Where creases end within the surface, nothing is cut.
    """
    # Half-edges at vertices that a crease touches, and the fan of connected faces that contains each
    count, faces = len(mesh.vertices), mesh.faces
    touched = marked(mesh.topology.edges[creases], count)
    corners = np.flatnonzero(touched[faces.ravel()])
    vertices = faces.ravel()[corners]
    fans = mesh.topology.fans(~creases)

    # Order the fans by the other corners of their faces, since the order of the faces must not affect the result
    others = np.sort(np.stack([faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]], axis=2).reshape(-1, 2)[corners], axis=1)
    lowest = np.full(fans.max() + 1, count**2)
    np.minimum.at(lowest, fans[corners], others[:, 0].astype(np.int64) * count + others[:, 1])
    rank = np.unique(lowest, return_inverse=True)[1]

    # One copy for each pair of vertex and fan; the first copy of a vertex keeps its index
    copies, copy = np.unique(vertices.astype(np.int64) * faces.size + rank[fans[corners]], return_inverse=True)
    owners = copies // faces.size
    further = np.concatenate([[False], owners[1:] == owners[:-1]])[: len(owners)]
    indices = np.where(further, count - 1 + np.cumsum(further), owners)

    # Faces that index the copies
    cut_faces = faces.ravel().astype(np.int64)
    cut_faces[corners] = indices[copy]
    owners = np.concatenate([np.arange(count), owners[further]])
    if not further.any():
        return CreaseSides(mesh, owners)
    return CreaseSides(Mesh(mesh.vertices[owners], cut_faces.reshape(-1, 3)), owners)
