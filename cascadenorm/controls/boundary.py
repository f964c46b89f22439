"""Smooth the boundary loops of open meshes while preserving corners.

The direction of each boundary edge is filtered bilaterally along the loop. Boundary vertices then move until their
edges match the filtered directions. This corresponds to bilateral normal filtering and the vertex update on a surface.
"""

from typing import NamedTuple

import numpy as np

from cascadenorm.mesh import Floats, Ints, Ints32, Mesh, Vectors, marked, scatter_add, unit

BOUNDARY_SPREAD = 1.5  # of the range weight, in median angles between consecutive guidance edges
ZIGZAG_SPREAD = 0.1  # minimum spread, in mean angles between consecutive boundary edges
MIN_SPREAD = 1e-9  # a smaller spread is due to rounding alone
DIRECTION_PASSES = 10
VERTEX_PASSES = 20
TINY = np.finfo(np.float64).tiny
SMOOTHING_STEP = 0.25  # half of the largest stable step
MAX_PUSHES = 100
MIN_AREA_FRACTION = 0.05  # minimum share of its area that each face keeps


class BoundaryEdges(NamedTuple):
    """The b boundary edges of a mesh, directed from tail to head like the face of each."""

    edges: Ints32  # (b, 2) vertex indices: tail, head
    neighbors: Ints  # (b, 2) adjacent boundary edge at either end; -1 if there is none or more than one
    signs: Floats  # (b, 2) -1 if the adjacent edge has the opposite direction, else 1

    @property
    def vertices(self) -> Ints32:
        """Boundary vertices, ascending."""
        return np.unique(self.edges)

    @property
    def inner(self) -> Ints32:
        """Vertices where exactly two boundary edges meet, ascending."""
        return np.unique(self.edges[self.neighbors >= 0])

    @classmethod
    def of(cls, edges: Ints32) -> "BoundaryEdges":
        """Find the adjacency of edges, (b, 2) vertex indices, with arbitrary directions."""
        # Number the tail of edge e as end 2 e and its head as 2 e + 1; pair the ends where exactly two meet at a vertex
        ends = edges.ravel()
        order = np.argsort(ends, kind="stable")
        in_pairs = np.bincount(ends)[ends[order]] == 2
        pairs = order[in_pairs].reshape(-1, 2)
        partner = np.full(len(ends), -2)
        partner[pairs] = pairs[:, ::-1]

        # The edges run in opposite directions if two tails or two heads meet
        partners = partner.reshape(-1, 2)
        return cls(edges, partners // 2, np.where(partners % 2 == np.arange(2), -1.0, 1.0))


def boundary_edges(mesh: Mesh, faces: Ints32 | None = None) -> BoundaryEdges:
    """Return the boundary edges of a mesh, without the degenerate edges of faces that repeat a vertex.

    If the mesh was cut, `faces` are its faces in the mesh that the edges are to refer to.
    """
    single = mesh.topology.edge_faces.counts[mesh.topology.face_edges] == 1
    proper = mesh.faces != np.roll(mesh.faces, -1, axis=1)
    corners = mesh.faces if faces is None else faces
    edges = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2)[single & proper]
    return BoundaryEdges.of(edges)


def smoothed_boundary(mesh: Mesh, boundary: BoundaryEdges, vertices: Vectors) -> Vectors:
    """Smooth the boundary along the surface; perpendicular to it, boundary vertices move as the method moved them.

    Face normals determine the position of a boundary vertex perpendicular to the surface but not along it. Along the
    surface, the displacement is that of `smoothed_curve`, which preserves circles and corners. `mesh` and `boundary`
    are those before the method, and `vertices`, (n, 3), are those after it. Vertices where loops end or meet move only
    perpendicular to the surface, and interior vertices stay where the method moved them. No face is flipped relative to
    its orientation after the method.
    """
    # Displacement of the method along the vertex normals, and of the curve in the tangent planes
    on = boundary.vertices
    normals = mesh.moved(vertices).vertex_normals[on]
    by_method = vertices[on] - mesh.vertices[on]
    by_curve = smoothed_curve(mesh.vertices, boundary)[on] - mesh.vertices[on]
    off_surface = np.einsum("ij,ij->i", normals, by_method - by_curve)

    smoothed = vertices.copy()
    smoothed[on] = mesh.vertices[on] + by_curve + off_surface[:, None] * normals
    return _unflipped(mesh.moved(vertices), smoothed, boundary.inner)


def _unflipped(mesh: Mesh, vertices: Vectors, movable: Ints32) -> Vectors:
    """Return the vertices, (n, 3), which change in place, without flipping faces relative to the mesh.

    A face with three boundary vertices flips if the smoothed boundary turns inward. The `movable` vertices, given by
    index, of such faces and of their neighbors are pushed apart in their tangent planes until each face keeps some of
    its area. The vertices of faces that remain flipped return to their positions in the mesh.
    """
    areas = np.linalg.norm(mesh.area_vectors, axis=1)
    faces = np.flatnonzero(np.isin(mesh.faces, movable).any(axis=1) & (areas > 0))
    corners, directions, areas = mesh.faces[faces], mesh.area_vectors[faces] / areas[faces, None], areas[faces]
    normals = mesh.vertex_normals
    free = np.zeros(len(vertices))
    free[movable] = 1.0
    for _ in range(MAX_PUSHES):
        a, b, c = np.moveaxis(vertices[corners], 1, 0)
        missing = MIN_AREA_FRACTION * areas - np.einsum("ij,ij->i", directions, np.cross(b - a, c - a)) / 2
        short = missing > 0
        if not short.any():
            break

        # Gradient of the area with respect to each vertex of the face, within the tangent plane
        apart = np.stack([c - b, a - c, b - a], axis=1)[short]
        slopes = np.cross(directions[short, None], apart) / 2 * free[corners[short], None]
        across = normals[corners[short]]
        slopes -= np.einsum("ijk,ijk->ij", slopes, across)[:, :, None] * across
        squared = (slopes**2).sum(axis=(1, 2))
        steps = np.divide(missing[short], squared, out=np.zeros_like(squared), where=squared > 0)
        steps = np.minimum(steps, np.sqrt(areas[short] / np.maximum(squared, TINY)))  # at most the face size
        pushes = scatter_add(corners[short].ravel(), (steps[:, None, None] * slopes).reshape(-1, 3), len(vertices))
        vertices += pushes / np.maximum(np.bincount(corners[short].ravel(), minlength=len(vertices)), 1)[:, None]
    return _restored(mesh, vertices)


def _restored(mesh: Mesh, vertices: Vectors) -> Vectors:
    """Return the vertices, with those of flipped faces moved back to their positions in the mesh."""
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
    """Return the vertices after fitting boundary edges to filtered directions; ends of open chains stay.

    The fit minimizes Σ |e - <e, d> d|² over the boundary edges e with directions d by `vertex_passes` steps of gradient
    descent. The directions are filtered in `passes` passes, with a spread in median angles between consecutive guidance
    edges.
    """
    directions = _filtered_directions(vertices, boundary, spread, passes)
    tail, head = boundary.edges.T
    inner = marked(boundary.inner, len(vertices))
    for _ in range(vertex_passes):
        edges = vertices[head] - vertices[tail]
        across = edges - np.einsum("ij,ij->i", edges, directions)[:, None] * directions
        pull = scatter_add(tail, across, len(vertices)) - scatter_add(head, across, len(vertices))
        vertices = vertices + np.where(inner[:, None], SMOOTHING_STEP * pull, 0.0)
    return vertices


def _filtered_directions(vertices: Vectors, boundary: BoundaryEdges, spread: float, passes: int) -> Vectors:
    """Return (b, 3) unit directions of the boundary edges after a joint bilateral filter along each loop.

    The range weight compares guidance directions, which are binomial means over five edges. These means cancel a zigzag
    from edge to edge but preserve corners.
    """
    edges = vertices[boundary.edges[:, 1]] - vertices[boundary.edges[:, 0]]
    lengths = np.linalg.norm(edges, axis=1)
    directions = unit(edges)
    has_neighbor = boundary.neighbors >= 0
    if not has_neighbor.any():
        return directions

    # Noise dominates the median angle of the guidance; a regular zigzag is visible only in the edges themselves
    guidance = _guidance(directions, lengths, boundary)
    spread *= np.median(_chords(guidance, boundary)[has_neighbor])
    spread = max(spread, ZIGZAG_SPREAD * _chords(directions, boundary)[has_neighbor].mean())
    if spread < MIN_SPREAD:
        return directions
    for _ in range(passes):
        # Weights of both neighbors: length times a Gaussian of the chord between the guidance directions
        guidance = _guidance(directions, lengths, boundary)
        weights = np.exp(-0.5 * (_chords(guidance, boundary) / spread) ** 2) * lengths[boundary.neighbors]
        signed = np.where(has_neighbor, boundary.signs * weights, 0.0)
        total = np.einsum("ij,ijk->ik", signed, directions[boundary.neighbors])
        directions = unit(lengths[:, None] * directions + total, otherwise=directions)
    return directions


def _guidance(directions: Vectors, lengths: Floats, boundary: BoundaryEdges) -> Vectors:
    """Return (b, 3) unit means of the directions, weighted by length and by 1, 4, 6, 4, 1 along the loop."""
    along = lengths[:, None] * directions
    has_neighbor = (boundary.neighbors >= 0)[:, :, None]
    for _ in range(2):
        beside = np.where(has_neighbor, boundary.signs[:, :, None] * along[boundary.neighbors], along[:, None])
        along = 2 * along + beside.sum(axis=1)
    return unit(along, otherwise=directions)


def _chords(directions: Vectors, boundary: BoundaryEdges) -> Floats:
    """Return (b, 2) chords between the direction of each edge and those of its neighbors."""
    chords = directions[:, None] - boundary.signs[:, :, None] * directions[boundary.neighbors]
    return np.asarray(np.linalg.norm(chords, axis=2))
