"""A uniform coarse copy of a mesh, and transfer of its deformation."""

import math
from typing import NamedTuple

import numpy as np

from cascadenorm.geometry.vertex_clusters import vertex_areas, vertex_clusters
from cascadenorm.mesh import (
    SMALLEST_COSTLY_CHUNK,
    Bools,
    Csr,
    Floats,
    Ints32,
    Mesh,
    Topology,
    Vectors,
    kernel,
    marked,
    parallel_for,
    scatter_add,
    without_repeated_faces,
)
from cascadenorm.mesh.averages import averaged
from cascadenorm.mesh.vectors import Vector, add, dot, row, scaled, subtract

LEAST_CLUSTERS = 100  # least number of clusters on each connected component with enough vertices
EDGE_HALVINGS = 4  # largest number of halvings of edges where the copy would be torn or folded, as on thin tubes
EVEN = 3  # smoothing passes over the offsets against shrinkage, so that the steps of the copy do not get sharper


class Feet(NamedTuple):
    """The nearest points of a coarse copy to n vertices."""

    faces: Ints32  # (n,) face of the copy with the nearest point; -1 if there is no face nearby
    weights: Floats  # (n, 3) barycentric coordinates of the nearest point
    outside: Bools  # (n,) whether the nearest point lies on the boundary of the copy

    def places(self, copy: Mesh) -> Vectors:
        """Return the (n, 3) positions of these points on the copy, or on a deformed version of it."""
        return np.asarray(np.einsum("ij,ijk->ik", self.weights, copy.corners[self.faces]))


class CoarseCopy(NamedTuple):
    """A coarse copy of a mesh with n vertices."""

    mesh: Mesh
    labels: Ints32  # (n,) vertex of the copy for the cluster of each vertex; -1 for a vertex without a face

    def feet(self, points: Vectors) -> Feet:
        """Find the point on the copy that is nearest to each vertex of the mesh, (n, 3).

        The search visits the faces within two rings of the vertex's cluster. This distinguishes sheets that are close
        together, and the cost per vertex does not depend on the size of the copy.
        """
        topology = self.mesh.topology
        single = topology.edge_faces.counts[topology.face_edges] == 1
        faces, outside = np.empty(len(points), np.int32), np.empty(len(points), bool)
        weights = np.empty((len(points), 3))
        arrays = self.mesh.vertices, self.mesh.faces, topology.vertex_faces, topology.vertex_neighbors, single
        filled = faces, weights, outside
        parallel_for(len(points), _feet_range, points, self.labels, *arrays, *filled, smallest=SMALLEST_COSTLY_CHUNK)
        return Feet(faces, weights, outside)

    def carried_over(self, points: Vectors, vertices: Vectors) -> Vectors:
        """Project points, (n, 3), onto the copy and return where they are on the copy with other vertices, (k, 3).

        A point beyond the boundary of the copy keeps its tangential distance from it. Points without a face of the copy
        nearby stay in place.
        """
        feet, after = self.feet(points), self.mesh.moved(vertices)
        beyond = points - feet.places(self.mesh)
        normals = after.face_normals[feet.faces]
        beyond -= np.einsum("ij,ij->i", beyond, normals)[:, None] * normals
        carried = feet.places(after) + np.where(feet.outside[:, None], beyond, 0.0)
        return np.where((feet.faces >= 0)[:, None], carried, points)


def coarse_copy(mesh: Mesh, length: float) -> CoarseCopy | None:
    """Return a coarse copy with edges of about a given length in mesh units, or None if no three clusters meet.

    The copy has a vertex for each cluster of vertices and a face where three clusters meet; duplicate faces count once.
    Its vertices are the centroids of the clusters (at a boundary, of their boundary vertices), moved along the normals
    to the mean position of the surface around them. Each connected component has at least LEAST_CLUSTERS clusters if it
    has enough vertices. Clusters are made smaller where the copy would have a hole, a fold or a non-manifold edge that
    the surface does not have.
    """
    spacing, faces = _spacing(mesh, length), without_repeated_faces(mesh).faces
    for halving in range(EDGE_HALVINGS + 1):
        labels = vertex_clusters(mesh, spacing)
        triangles, twice = _triangles(labels[faces])
        torn = _torn(mesh, labels, triangles, twice)
        if halving == EDGE_HALVINGS or not torn.any():
            break
        spacing = np.where((labels >= 0) & torn[labels], spacing / 2, spacing)
    if not len(triangles):
        return None
    return _fitted(CoarseCopy(Mesh(_centroids(mesh, labels), triangles), labels), mesh)


def _spacing(mesh: Mesh, length: float) -> Floats:
    """Return the (n,) distance between clusters around each vertex: `length`, or less on small components."""
    components = mesh.topology.components
    areas = scatter_add(mesh.topology.face_components, mesh.areas, mesh.topology.component_count)
    smallest = np.sqrt(areas / (LEAST_CLUSTERS * math.sqrt(0.75)))  # a hexagon of width d has the area √¾ d²
    return np.maximum(np.minimum(length, smallest), np.finfo(float).tiny)[components]


def _triangles(corners: Ints32) -> tuple[Ints32, Bools]:
    """Return the faces of the copy, (t, 3), and whether the surface has each of them in both orientations, (t,).

    The corners, (m, 3), are the clusters of the faces of the mesh. The majority of the faces between three clusters
    determines the orientation of the face of the copy.
    """
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    order = np.argsort(corners, axis=1)
    turn = np.where((order[:, 0] + 1) % 3 == order[:, 1], 1, -1)
    triangles, which = np.unique(np.take_along_axis(corners, order, axis=1), axis=0, return_inverse=True)
    sums = np.bincount(which.ravel(), turn, minlength=len(triangles))
    counts = np.bincount(which.ravel(), minlength=len(triangles))
    triangles[sums < 0] = triangles[sums < 0][:, [0, 2, 1]]
    return triangles.astype(np.int32), np.abs(sums) < counts


def _torn(mesh: Mesh, labels: Ints32, triangles: Ints32, twice: Bools) -> Bools:
    """Return (k,) whether the copy is torn or folded at each cluster; False for clusters of one vertex."""
    count = int(labels.max()) + 1
    torn = ~marked(triangles, count) | marked(triangles[twice], count)  # clusters without a face, or with a double one
    copy, topology = Topology(triangles, count), mesh.topology
    torn[copy.edges[copy.edge_faces.counts > 2]] = True
    torn[labels[topology.edges[topology.edge_faces.counts > 2]]] = False
    return torn & (np.bincount(labels[labels >= 0], minlength=count) > 1)


def _centroids(mesh: Mesh, labels: Ints32) -> Vectors:
    """Return the (k, 3) centroid of each cluster, or of its boundary vertices if it has any."""
    count = int(labels.max()) + 1
    boundary, inside = mesh.topology.boundary_vertices, labels >= 0
    at_boundary = marked(labels[boundary], count)
    weights = np.where(at_boundary[labels] & ~boundary, 0.0, vertex_areas(mesh))[inside]
    sums = scatter_add(labels[inside], weights[:, None] * mesh.vertices[inside], count)
    return np.asarray(sums / scatter_add(labels[inside], weights, count)[:, None])


def _fitted(copy: CoarseCopy, mesh: Mesh) -> CoarseCopy:
    """Offset the vertices of a copy along their normals by the mean distance between the surface and its faces.

    The centroid of a cluster lies on the inner side of a curved surface, so the copy would otherwise be too small.
    """
    feet = copy.feet(mesh.vertices)
    weights = feet.weights * (vertex_areas(mesh) * ((feet.faces >= 0) & ~feet.outside))[:, None]
    between = weights[:, :, None] * (mesh.vertices - feet.places(copy.mesh))[:, None]
    count, corners = len(copy.mesh.vertices), copy.mesh.faces[feet.faces].ravel()
    sums, totals = scatter_add(corners, between.reshape(-1, 3), count), scatter_add(corners, weights.ravel(), count)
    normals = copy.mesh.vertex_normals
    heights = np.einsum("ij,ij->i", sums, normals) / np.maximum(totals, np.finfo(float).tiny)
    heights = averaged(heights, copy.mesh.topology.vertex_neighbors, EVEN)
    return copy._replace(mesh=copy.mesh.moved(copy.mesh.vertices + heights[:, None] * normals))


@kernel
def _feet_range(
    start: int,
    stop: int,
    points: Vectors,
    labels: Ints32,
    vertices: Vectors,
    triangles: Ints32,
    around: Csr,
    neighbors: Csr,
    single: Bools,
    faces: Ints32,
    weights: Floats,
    outside: Bools,
) -> None:
    """Search the faces around each point's cluster and its neighbours; the lowest index breaks ties."""
    for i in range(start, stop):
        faces[i], weights[i], outside[i], best = -1, 0.0, False, np.inf
        cluster = labels[i]
        if cluster < 0:
            continue
        first = neighbors.indptr[cluster]
        for k in range(first - 1, neighbors.indptr[cluster + 1]):
            near = neighbors.indices[k] if k >= first else cluster
            for face in around.indices[around.indptr[near] : around.indptr[near + 1]]:
                a, b, c = triangles[face]
                u, v, w, distance = foot(row(points, i), row(vertices, a), row(vertices, b), row(vertices, c))
                if distance < best or (distance == best and face < faces[i]):
                    best, faces[i] = distance, face
                    weights[i, 0], weights[i, 1], weights[i, 2] = u, v, w
        for side in range(3):
            if faces[i] >= 0 and single[faces[i], side] and weights[i, (side + 2) % 3] == 0.0:
                outside[i] = True


@kernel
def foot(p: Vector, a: Vector, b: Vector, c: Vector) -> tuple[float, float, float, float]:
    """Return the barycentric coordinates of the nearest point of a triangle, and its squared distance (Ericson 2005).

    A coordinate is exactly 0 if the nearest point lies on the opposite side, including its ends.
    """
    ab, ac, bc = subtract(b, a), subtract(c, a), subtract(c, b)
    ap, bp, cp = subtract(p, a), subtract(p, b), subtract(p, c)
    ab_a, ac_a, ab_b, ac_b, ab_c, ac_c = dot(ab, ap), dot(ac, ap), dot(ab, bp), dot(ac, bp), dot(ab, cp), dot(ac, cp)
    # the three corners
    if ab_a <= 0 and ac_a <= 0:
        return 1.0, 0.0, 0.0, dot(ap, ap)
    if ab_b >= 0 and ac_b <= ab_b:
        return 0.0, 1.0, 0.0, dot(bp, bp)
    if ac_c >= 0 and ab_c <= ac_c:
        return 0.0, 0.0, 1.0, dot(cp, cp)
    # the three sides
    of_c, of_b, of_a = ab_a * ac_b - ab_b * ac_a, ab_c * ac_a - ab_a * ac_c, ab_b * ac_c - ab_c * ac_b
    if of_c <= 0 and ab_a >= 0 and ab_b <= 0:
        share = ab_a / (ab_a - ab_b)
        away = subtract(ap, scaled(share, ab))
        return 1 - share, share, 0.0, dot(away, away)
    if of_b <= 0 and ac_a >= 0 and ac_c <= 0:
        share = ac_a / (ac_a - ac_c)
        away = subtract(ap, scaled(share, ac))
        return 1 - share, 0.0, share, dot(away, away)
    if of_a <= 0:
        share = (ac_b - ab_b) / ((ac_b - ab_b) + (ab_c - ac_c))
        away = subtract(bp, scaled(share, bc))
        return 0.0, 1 - share, share, dot(away, away)
    # the interior
    total = of_a + of_b + of_c
    u, v, w = of_a / total, of_b / total, of_c / total
    away = subtract(ap, add(scaled(v, ab), scaled(w, ac)))
    return u, v, w, dot(away, away)
