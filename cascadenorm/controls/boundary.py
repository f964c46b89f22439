"""Boundary loops of open meshes, smoothed as curves along the surface while their corners stay.

The direction of each boundary edge is filtered bilaterally along the loop, and boundary vertices move until their edges
have the filtered directions: for a curve what bilateral filtering of normals and the vertex update are for a surface.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Mesh, Vectors, scatter_add, unit

BOUNDARY_SPREAD = 0.7  # of the range weight, in median angles from edge to edge along the boundary
DIRECTION_PASSES = 10
VERTEX_PASSES = 20
SMOOTHING_STEP = 0.25  # half of the largest stable one


class BoundaryEdges(NamedTuple):
    """The b edges with a single face, each from tail to head as its face runs.

    Parameters
    ----------
    edges
        (b, 2) vertices: tail, head.
    neighbors
        (b, 2) the boundary edge that follows at either end; -1 where there is none, or more than one.
    signs
        (b, 2) -1 where that edge runs against this one, else 1.
    """

    edges: NDArray[np.int32]
    neighbors: NDArray[np.int64]
    signs: NDArray[np.float64]

    @property
    def vertices(self) -> NDArray[np.int32]:
        """Boundary vertices, ascending."""
        return np.unique(self.edges)

    @classmethod
    def of(cls, edges: NDArray[np.int32]) -> "BoundaryEdges":
        """Find what follows what among edges, (b, 2) vertices, in any directions."""
        return cls(edges, *_neighbors(edges))


def boundary_edges(mesh: Mesh, faces: NDArray[np.int32] | None = None) -> BoundaryEdges:
    """Return the boundary edges of a mesh; the degenerate edge of a face with a repeated vertex is none.

    Parameters
    ----------
    faces
        The faces over copies of the vertices, if the edges are to be those of a mesh that was cut.
    """
    single = mesh.topology.edge_faces.counts[mesh.topology.face_edges] == 1
    proper = mesh.faces != np.roll(mesh.faces, -1, axis=1)
    corners = mesh.faces if faces is None else faces
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)[single & proper]
    return BoundaryEdges.of(edges)


def _neighbors(edges: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the neighbors and signs of `BoundaryEdges`."""
    # Number the tail of edge e as end 2 e and its head as 2 e + 1; pair the ends at a vertex where exactly two meet
    ends = edges.ravel()
    order = np.argsort(ends, kind="stable")
    in_pairs = np.bincount(ends)[ends[order]] == 2
    pairs = order[in_pairs].reshape(-1, 2)
    partner = np.full(len(ends), -2)
    partner[pairs] = pairs[:, ::-1]

    # Two tails or two heads meet where the edges run against each other
    partners = partner.reshape(-1, 2)
    return partners // 2, np.where(partners % 2 == np.arange(2), -1.0, 1.0)


def smoothed_boundary(mesh: Mesh, boundary: BoundaryEdges, vertices: Vectors) -> Vectors:
    """Smooth the boundary along the surface; off the surface its vertices move as a method has moved them.

    Face normals determine the position of a boundary vertex off the surface, but not along it. There the displacement
    is that of the boundary as a curve (see `smoothed_curve`), which keeps circles and corners.

    Parameters
    ----------
    mesh
        n vertices before the method.
    boundary
        Its boundary edges.
    vertices
        (n, 3) after the method.

    Returns
    -------
    (n, 3); where loops end or meet, a vertex moves off the surface alone. Other vertices, and those whose
    displacement along the surface would flip a face, are where the method moved them
    """
    # Displacement of the method along the vertex normals, of the curve across them
    on = boundary.vertices
    normals = mesh.moved(vertices).vertex_normals[on]
    by_method = vertices[on] - mesh.vertices[on]
    by_curve = smoothed_curve(mesh.vertices, boundary)[on] - mesh.vertices[on]
    off_surface = np.einsum("ij,ij->i", normals, by_method - by_curve)

    smoothed = vertices.copy()
    smoothed[on] = mesh.vertices[on] + by_curve + off_surface[:, None] * normals
    return _unflipped(mesh.moved(vertices), smoothed)


def _unflipped(mesh: Mesh, vertices: Vectors) -> Vectors:
    """Return the vertices with those of faces that are flipped against the mesh back at their places in it."""
    while True:
        flipped = np.einsum("ij,ij->i", mesh.area_vectors, mesh.moved(vertices).area_vectors) < 0
        if not flipped.any():
            return vertices
        vertices[mesh.faces[flipped]] = mesh.vertices[mesh.faces[flipped]]


def smoothed_curve(
    vertices: Vectors,
    boundary: BoundaryEdges,
    *,
    spread: float = BOUNDARY_SPREAD,
    passes: int = DIRECTION_PASSES,
    vertex_passes: int = VERTEX_PASSES,
) -> Vectors:
    """Return the vertices with boundary edges in filtered directions; ends of open chains stay.

    Gradient descent on Σ |e - <e, d> d|² over the boundary edges e with directions d.

    Parameters
    ----------
    spread
        Of the range weight, in median angles from edge to edge.
    passes
        Of the filter of the directions.
    vertex_passes
        Steps of the descent.
    """
    directions = _filtered_directions(vertices, boundary, spread, passes)
    tail, head = boundary.edges.T
    inner = np.zeros(len(vertices), bool)
    inner[boundary.edges[boundary.neighbors >= 0]] = True
    for _ in range(vertex_passes):
        edges = vertices[head] - vertices[tail]
        across = edges - np.einsum("ij,ij->i", edges, directions)[:, None] * directions
        pull = scatter_add(tail, across, len(vertices)) - scatter_add(head, across, len(vertices))
        vertices = vertices + np.where(inner[:, None], SMOOTHING_STEP * pull, 0.0)
    return vertices


def _filtered_directions(vertices: Vectors, boundary: BoundaryEdges, spread: float, passes: int) -> Vectors:
    """Return (b, 3) the unit direction of each boundary edge, filtered bilaterally along its loop.

    The spread of the range weight is a multiple of the median angle between consecutive edges, which noise dominates.
    """
    edges = vertices[boundary.edges[:, 1]] - vertices[boundary.edges[:, 0]]
    lengths = np.linalg.norm(edges, axis=1)
    directions = unit(edges)
    has_neighbor = boundary.neighbors >= 0
    spread *= np.median(_chords(directions, boundary)[has_neighbor]) if has_neighbor.any() else 0.0
    if spread == 0:
        return directions
    for _ in range(passes):
        # Weights of both neighbors: length times a Gaussian of the chord between the directions
        weights = np.exp(-0.5 * (_chords(directions, boundary) / spread) ** 2) * lengths[boundary.neighbors]
        signed = np.where(has_neighbor, boundary.signs * weights, 0.0)
        total = np.einsum("ij,ijk->ik", signed, directions[boundary.neighbors])
        directions = unit(lengths[:, None] * directions + total, otherwise=directions)
    return directions


def _chords(directions: Vectors, boundary: BoundaryEdges) -> NDArray[np.float64]:
    """(b, 2) chord between the direction of each edge and those of its neighbors."""
    chords = directions[:, None] - boundary.signs[:, :, None] * directions[boundary.neighbors]
    return np.asarray(np.linalg.norm(chords, axis=2))
