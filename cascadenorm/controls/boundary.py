"""Rims of open meshes as curves, smoothed along the surface while their corners stay."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Mesh, Vectors, unit

SPREAD = 0.7  # of directions that are averaged, in median turns of the rim from edge to edge: what noise makes of it
PASSES = 10  # over the directions of the edges
STEPS = 20  # of the vertices towards them
STEP = 0.25  # half of what is stable


class Rim(NamedTuple):
    """The r edges that have a single face, each from tail to head as its face runs.

    Parameters
    ----------
    edges : (r, 2) vertices: tail, head
    onward : (r, 2) the edge that the rim goes on with at either end; -1 where there is none, or more than one
    signs : (r, 2) -1 where that edge runs against this one, else 1
    """

    edges: NDArray[np.int32]
    onward: NDArray[np.int64]
    signs: NDArray[np.float64]

    @property
    def vertices(self) -> NDArray[np.int32]:
        """Vertices on the rim, ascending."""
        return np.unique(self.edges)


def rim_of(mesh: Mesh, faces: NDArray[np.int32] | None = None) -> Rim:
    """Find the rim of a mesh, in the vertices that `faces` name where these are copies of its own.

    A side of a face that begins and ends at one vertex is no edge.
    """
    single = mesh.topology.edge_faces.counts[mesh.topology.face_edges] == 1
    proper = mesh.faces != np.roll(mesh.faces, -1, axis=1)
    named = mesh.faces if faces is None else faces
    edges = np.stack([named, np.roll(named, -1, axis=1)], axis=2)[single & proper]
    return Rim(edges, *_followers(edges))


def _followers(edges: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return what `Rim` calls onward and signs."""
    ends = edges.ravel()
    order = np.argsort(ends, kind="stable")
    in_pairs = np.bincount(ends)[ends[order]] == 2
    pairs = order[in_pairs].reshape(-1, 2)
    partner = np.full(len(ends), -2)
    partner[pairs] = pairs[:, ::-1]
    partners = partner.reshape(-1, 2)
    return partners // 2, np.where(partners % 2 == np.arange(2), -1.0, 1.0)  # two tails or two heads meet


def along_the_rim(mesh: Mesh, rim: Rim, vertices: Vectors) -> Vectors:
    """Let vertices on the rim move along the surface as the rim becomes smooth, and off it as they have moved already.

    Along the surface a rim is a curve, and no normal says where it runs. So the directions of its edges are averaged
    with those of the edges before and after, the less the more they differ, which keeps corners; then its vertices
    move until the edges have these directions. That is bilateral filtering of normals, of a curve. How far
    directions of one line differ is taken from the median turn between edges that follow each other. A rim of equal
    edges with equal turns, a circle, stays.

    Parameters
    ----------
    mesh : as it was
    rim : of this mesh
    vertices : (n, 3) where a method moved them

    Returns
    -------
    (n, 3); where a rim ends or branches, a vertex moves off the surface alone. Vertices that are not on the rim, and
    those whose way along it would turn a face parallel_for, are where the method moved them
    """
    inside = rim.vertices
    normals = mesh.moved(vertices).vertex_normals[inside]
    moved = vertices[inside] - mesh.vertices[inside]
    along = _smoothed(mesh.vertices, rim)[inside] - mesh.vertices[inside]
    off = np.einsum("ij,ij->i", normals, moved - along)
    joined = vertices.copy()
    joined[inside] = mesh.vertices[inside] + along + off[:, None] * normals
    return _unfolded(mesh.moved(vertices), joined)


def _unfolded(mesh: Mesh, vertices: Vectors) -> Vectors:
    """Return the vertices with those of faces that would be turned over back in the mesh."""
    while True:
        turned = np.einsum("ij,ij->i", mesh.area_vectors, mesh.moved(vertices).area_vectors) < 0
        if not turned.any():
            return vertices
        vertices[mesh.faces[turned]] = mesh.vertices[mesh.faces[turned]]


def _smoothed(vertices: Vectors, rim: Rim) -> Vectors:
    """Return vertices with those of the rim where its edges have averaged directions; its ends stay."""
    directions = _directions(vertices, rim)
    tail, head = rim.edges.T
    goes_on = np.zeros(len(vertices), bool)
    goes_on[rim.edges[rim.onward >= 0]] = True
    for _ in range(STEPS):
        edges = vertices[head] - vertices[tail]
        askew = edges - np.einsum("ij,ij->i", edges, directions)[:, None] * directions
        pull = [np.bincount(tail, a, len(vertices)) - np.bincount(head, a, len(vertices)) for a in askew.T]
        vertices = vertices + np.where(goes_on[:, None], STEP * np.stack(pull, axis=1), 0.0)
    return vertices


def _directions(vertices: Vectors, rim: Rim) -> Vectors:
    """Average the direction of each edge with those that follow at its ends."""
    edges = vertices[rim.edges[:, 1]] - vertices[rim.edges[:, 0]]
    lengths = np.linalg.norm(edges, axis=1)
    directions = unit(edges)
    goes_on = rim.onward >= 0
    spread = SPREAD * np.median(_turns(directions, rim)[goes_on]) if goes_on.any() else 0.0
    if spread == 0:
        return directions
    for _ in range(PASSES):
        weights = np.exp(-0.5 * (_turns(directions, rim) / spread) ** 2) * lengths[rim.onward]
        shares = np.where(goes_on, rim.signs * weights, 0.0)
        both = np.einsum("ij,ijk->ik", shares, directions[rim.onward])
        directions = unit(lengths[:, None] * directions + both, otherwise=directions)
    return directions


def _turns(directions: Vectors, rim: Rim) -> NDArray[np.float64]:
    """(r, 2) chord between the direction of each edge and that of those which follow."""
    chords = directions[:, None] - rim.signs[:, :, None] * directions[rim.onward]
    return np.asarray(np.linalg.norm(chords, axis=2))
