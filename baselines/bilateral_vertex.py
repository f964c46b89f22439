"""Bilateral filters that move vertices directly (Fleishman, Drori, Cohen-Or 2003; Jones, Durand, Desbrun 2003)."""

from typing import Annotated

import numpy as np

from cascadenorm.execution.progress import track
from cascadenorm.geometry.neighborhoods import each_alone, within
from cascadenorm.mesh import Csr, Floats, Mesh, Vectors, kernel, parallel_for, row_distances, unit
from cascadenorm.mesh.vectors import add, divided, dot, row, scaled, squared_distance, subtract
from cascadenorm.registry import Parameter, method

NEIGHBOR_CUTOFF = 2.0  # spreads beyond which a neighbour is left out
COLLAPSED = 1e-12  # ratio of the areas after and before pre-smoothing up to which a face keeps its normal

Steps = Annotated[int, Parameter("Number of steps", minimum=0)]
Closeness = Annotated[
    float | None,
    Parameter("Spread over distance. Default: the shortest edge at each vertex", "mean edge lengths", minimum=1e-6),
]
Similarity = Annotated[
    float | None,
    Parameter("Spread over height. Default: that of the neighbours of each vertex", "mean edge lengths", minimum=1e-6),
]
Spatial = Annotated[float, Parameter("Spread over the distance to a face", "mean edge lengths", minimum=1e-6)]
Influence = Annotated[
    float, Parameter("Spread over the distance to the plane of a face", "mean edge lengths", minimum=1e-6)
]


@method("bilateral", source="Fleishman, Drori, Cohen-Or 2003", family="bilateral")
def bilateral(mesh: Mesh, *, sigma_c: Closeness = None, sigma_s: Similarity = None, iterations: Steps = 12) -> Vectors:
    """Move each vertex along its normal by a bilateral mean of the heights of near vertices over its tangent plane.

    Neighbours are the vertex itself and the vertices within 2 σ_c that are connected to it through such vertices. By
    default, σ_s is the standard deviation of their absolute heights. Boundaries get no special treatment.

    Formula
    -------
    x_i ← x_i + n_i Σ_j W_c W_s h_j / Σ_j W_c W_s,   h_j = <n_i, x_j - x_i>
    W_c = exp(-|x_j - x_i|²/2σ_c²),   W_s = exp(-h_j²/2σ_s²)

    Limits
    ------
    It shrinks the mesh, because the mean height over a tangent plane is not zero on curved surfaces. Edges are kept
    less well than by filters of normals. The vertex normals are as noisy as the mesh.
    """
    count, edge = len(mesh.vertices), mesh.mean_edge_length
    graph, alone = mesh.topology.vertex_neighbors, each_alone(count)
    height_spread = 0.0 if sigma_s is None else sigma_s * edge
    for _ in track(iterations):
        spreads = shortest_edges(mesh) if sigma_c is None else np.full(count, sigma_c * edge)
        near = within(mesh.vertices, NEIGHBOR_CUTOFF * spreads, mesh.vertices, graph, alone)
        moved = np.empty_like(mesh.vertices)
        parallel_for(count, _bilateral_step, mesh.vertices, vertex_normals(mesh), spreads, height_spread, near, moved)
        mesh = mesh.moved(moved)
    return mesh.vertices.copy()


@method("non-iterative-bilateral", source="Jones, Durand, Desbrun 2003", family="bilateral")
def non_iterative_bilateral(mesh: Mesh, *, sigma_f: Spatial = 1.5, sigma_g: Influence = 1.0) -> Vectors:
    """Move each vertex once, to a bilateral mean of its projections onto the planes of near faces.

    The normals of the planes are computed after each vertex was moved to the Gaussian mean of near centroids, with the
    spread σ_f/2. Neighbours are the faces with a centroid within 2 σ_f of the vertex that are connected to its own
    faces through such faces.

    Formula
    -------
    x_i ← Σ_f A_f W_f W_g Π_f(x_i) / Σ_f A_f W_f W_g,   Π_f: projection on the plane of face f
    W_f = exp(-|c_f - x_i|²/2σ_f²),   W_g = exp(-|Π_f(x_i) - x_i|²/2σ_g²)

    Limits
    ------
    One pass removes light noise only, and wide spreads round edges. The result depends on the pre-smoothed normals, in
    which thin features are lost.
    """
    count, edge = len(mesh.vertices), mesh.mean_edge_length
    topology, spread = mesh.topology, sigma_f * edge
    radii = np.full(count, NEIGHBOR_CUTOFF * spread)
    near = within(mesh.vertices, radii, mesh.centroids, topology.face_rings(1), topology.vertex_faces)
    mollified = np.empty_like(mesh.vertices)
    parallel_for(count, _centroid_means, mesh.vertices, mesh.centroids, mesh.areas, 0.5 * spread, near, mollified)
    smooth = mesh.moved(mollified)
    # the vertices of a component of one or two faces move onto a line, where rounding determines the normals
    collapsed = smooth.areas <= COLLAPSED * mesh.areas
    normals = np.where(collapsed[:, None], mesh.face_normals, smooth.face_normals)
    out = np.empty_like(mesh.vertices)
    parallel_for(
        count, _projection_means, mesh.vertices, mesh.centroids, mesh.areas, normals, spread, sigma_g * edge, near, out
    )  # fmt: skip
    return out


def vertex_normals(mesh: Mesh) -> Vectors:
    """Return the (n, 3) normalised sums of the unit normals of the faces around each vertex; zero where they cancel."""
    return unit(mesh.sums_around(mesh.face_normals))


def shortest_edges(mesh: Mesh) -> Floats:
    """Return the (n,) length of the shortest edge at each vertex; 0 without an edge."""
    least, lengths = np.full(len(mesh.vertices), np.inf), row_distances(mesh.vertices, mesh.topology.edges)
    for ends in mesh.topology.edges.T:
        np.minimum.at(least, ends, lengths)
    return np.where(np.isinf(least), 0.0, least)


@kernel
def _bilateral_step(
    start: int,
    stop: int,
    vertices: Vectors,
    normals: Vectors,
    spreads: Floats,
    height_spread: float,
    near: Csr,
    moved: Vectors,
) -> None:
    for i in range(start, stop):
        place, normal = row(vertices, i), row(normals, i)

        # heights of the neighbours over the tangent plane, and their scatter
        first, last = near.indptr[i], near.indptr[i + 1]
        heights = np.empty(last - first)
        mean = 0.0
        for k in range(first, last):
            heights[k - first] = dot(normal, subtract(row(vertices, near.indices[k]), place))
            mean += abs(heights[k - first])
        mean /= last - first
        variance = height_spread * height_spread
        if height_spread == 0.0:
            for h in heights:
                variance += (abs(h) - mean) ** 2
            variance /= last - first

        # their mean, weighted by distance and height, is the step along the normal
        step = total = 0.0
        if variance > 0.0 and spreads[i] > 0.0:
            for k in range(first, last):
                h = heights[k - first]
                distance = squared_distance(row(vertices, near.indices[k]), place)
                w = np.exp(-0.5 * (distance / (spreads[i] * spreads[i]) + h * h / variance))
                step += w * h
                total += w
            step /= total  # the vertex itself has the weight 1
        moved[i, 0], moved[i, 1], moved[i, 2] = add(place, scaled(step, normal))


@kernel
def _centroid_means(
    start: int, stop: int, vertices: Vectors, centroids: Vectors, areas: Floats, spread: float, near: Csr, out: Vectors
) -> None:
    """Take the Gaussian mean of near centroids; a vertex without any stays."""
    for i in range(start, stop):
        # vectors to near centroids, weighted by area and distance
        move, total = (0.0, 0.0, 0.0), 0.0
        for k in range(near.indptr[i], near.indptr[i + 1]):
            f = near.indices[k]
            way = subtract(row(centroids, f), row(vertices, i))
            w = areas[f] * np.exp(-0.5 * dot(way, way) / (spread * spread))
            move, total = add(move, scaled(w, way)), total + w
        mean = divided(move, total if total > 0.0 else 1.0)
        out[i, 0], out[i, 1], out[i, 2] = add(row(vertices, i), mean)


@kernel
def _projection_means(
    start: int,
    stop: int,
    vertices: Vectors,
    centroids: Vectors,
    areas: Floats,
    normals: Vectors,
    spread: float,
    influence: float,
    near: Csr,
    out: Vectors,
) -> None:
    """Take the weighted mean of the projections onto the planes of near faces; a vertex without any stays."""
    for i in range(start, stop):
        # vectors to the planes, weighted by area, distance of the centroid and height over the plane
        move, total = (0.0, 0.0, 0.0), 0.0
        for k in range(near.indptr[i], near.indptr[i + 1]):
            f = near.indices[k]
            way = subtract(row(centroids, f), row(vertices, i))
            height = dot(row(normals, f), way)
            distance = dot(way, way) / (spread * spread)
            w = areas[f] * np.exp(-0.5 * (distance + height * height / (influence * influence)))
            move, total = add(move, scaled(w * height, row(normals, f))), total + w
        mean = divided(move, total if total > 0.0 else 1.0)
        out[i, 0], out[i, 1], out[i, 2] = add(row(vertices, i), mean)
