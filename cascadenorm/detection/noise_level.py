"""How noisy a mesh is, estimated from the mesh alone."""

from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Csr, Floats, Index, Ints32, Mesh, Vectors, kernel, parallel_for, scatter_add
from cascadenorm.mesh.vectors import add, dot, length, row, squared_distance

SAMPLES = 50_000  # edges looked at, evenly spread over their numbers
FEWEST_EDGES = 30  # edges below which nothing is said
START = 0.2  # share of the differences that are surely no creases
CLIP = 1.5  # standard deviations beyond which a difference may belong to a crease
_NORMAL = NormalDist()
KEPT_VARIANCE = 1 - 2 * CLIP * _NORMAL.pdf(CLIP) / (2 * _NORMAL.cdf(CLIP) - 1)  # of a Gaussian that is cut off there
CLIPPING_ROUNDS = 50


def noise_level(mesh: Mesh) -> float | None:
    """Estimate the standard deviation of the noise along the normal, in mean edge lengths of the mesh as it is.

    The height of a vertex i over the mean of its k_i neighbours, h_i = <x_i - mean_j x_j, n>, over the mean of their
    squared distances s_i, is half the mean curvature where the surface is smooth, so that between two neighbours it
    hardly changes, however regular the mesh. What does change is noise: for an edge ij

        e = s (h_i / s_i - h_j / s_j),    s = (s_i + s_j) / 2

    is a weighted sum of heights, whose variance on a plane is that of the noise times the sum of the squared weights.
    Each e is divided by the root of that sum; their standard deviation is then that of the noise. It is taken over
    those within CLIP of it, found by iteration from the smallest, so that creases hardly count.

    Right within 25 % from 0.05 to 0.5 where less than a third of the edges are near creases; below 0.02 for what is
    clean and smooth. Detail as fine as the mesh cannot be told from noise; noise that is alike in neighbouring
    vertices, as of a smoothed scan, is not seen.

    Returns
    -------
    In mean edge lengths; None where there are too few edges away from the boundary
    """
    edges = _inner_edges(mesh)
    if len(edges) < FEWEST_EDGES:
        return None
    edges = edges[np.linspace(0, len(edges) - 1, min(SAMPLES, len(edges))).astype(np.int64)]
    differences = _differences_along(mesh, edges)
    known = differences[np.isfinite(differences)]
    return _clipped_deviation(known) / mesh.mean_edge_length if len(known) >= FEWEST_EDGES else None


def local_noise(mesh: Mesh) -> NDArray[np.float64]:
    """Estimate the noise along the normal around each vertex, in mean edge lengths of the mesh.

    The root mean square of the differences that `noise_level` describes, over the edges of a vertex and of its
    neighbours. Creases count in full here.

    Returns
    -------
    (n,); NaN where no edge is away from the boundary
    """
    edges = _inner_edges(mesh)
    squares = np.square(_differences_along(mesh, edges)) if len(edges) else np.empty(0)
    edges, squares = edges[np.isfinite(squares)], squares[np.isfinite(squares)]
    count = len(mesh.vertices)
    total = scatter_add(edges.ravel(), np.repeat(squares, 2), count)
    number = np.bincount(edges.ravel(), minlength=count).astype(np.float64)
    a, b = mesh.topology.edges.T
    around, numbers = (x + scatter_add(a, x[b], count) + scatter_add(b, x[a], count) for x in (total, number))
    variance = np.divide(around, numbers, out=np.full(count, np.nan), where=numbers > 0)
    return np.asarray(np.sqrt(variance) / mesh.mean_edge_length)


def _differences_along(mesh: Mesh, edges: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return e of each edge; NaN where a vertex has no extent around it."""
    around = mesh.topology.vertex_neighbors
    differences = np.empty(len(edges))
    parallel_for(
        len(edges),
        _differences,
        mesh.vertices,
        mesh.vertex_area_vectors,  # they do not depend on where the vertices themselves are
        edges,
        around,
        differences,
    )
    return differences


def _inner_edges(mesh: Mesh) -> NDArray[np.int32]:
    """Edges with two faces, no end of which lies on an edge with one or with more than two."""
    topology = mesh.topology
    on_border = np.zeros(len(mesh.vertices), bool)
    on_border[topology.edges[topology.edge_faces.counts != 2]] = True
    edges = topology.edges[topology.interior_edges]
    return np.ascontiguousarray(edges[~on_border[edges].any(axis=1)])


def _clipped_deviation(differences: NDArray[np.float64]) -> float:
    """Standard deviation about 0 of the Gaussian that the smaller differences come from."""
    sizes = np.abs(differences)
    deviation = float(np.quantile(sizes, START) / _NORMAL.inv_cdf(0.5 + START / 2))
    for _ in range(CLIPPING_ROUNDS):
        within = sizes[sizes <= CLIP * deviation]
        deviation = float(np.sqrt(np.square(within).mean() / KEPT_VARIANCE)) if len(within) else 0.0
    return deviation


@kernel
def _differences(
    start: int,
    stop: int,
    vertices: Vectors,
    vectors: Vectors,
    edges: Ints32,
    neighbors: Csr,
    out: Floats,
) -> None:
    """Fill in the differences of edges start … stop, in plain arithmetic, which loads no part of numba's compiler."""
    for e in range(start, stop):
        i, j = edges[e, 0], edges[e, 1]
        normal = add(row(vectors, i), row(vectors, j))
        size = length(normal)
        spread_i, spread_j = _spread(vertices, neighbors, i), _spread(vertices, neighbors, j)
        # no direction, or neighbours in one place: nothing can be said
        if size == 0 or spread_i == 0 or spread_j == 0:
            out[e] = np.nan
            continue
        a, b = 0.5 + 0.5 * spread_j / spread_i, 0.5 + 0.5 * spread_i / spread_j
        a_each, b_each = (
            a / (neighbors.indptr[i + 1] - neighbors.indptr[i]),
            b / (neighbors.indptr[j + 1] - neighbors.indptr[j]),
        )
        at_i, at_j = a + b_each, -b - a_each
        # height is the combination of positions along the normal, squares the sum of its squared weights
        squares = at_i * at_i + at_j * at_j
        height = at_i * dot(row(vertices, i), normal) + at_j * dot(row(vertices, j), normal)
        # neighbours of i, of which some are those of j as well, then those of j alone
        for k in range(neighbors.indptr[i], neighbors.indptr[i + 1]):
            v = neighbors.indices[k]
            if v != j:
                weight = -a_each + (b_each if _adjacent(neighbors, j, v) else 0.0)
                squares += weight * weight
                height += weight * dot(row(vertices, v), normal)
        for k in range(neighbors.indptr[j], neighbors.indptr[j + 1]):
            v = neighbors.indices[k]
            if v != i and not _adjacent(neighbors, i, v):
                squares += b_each * b_each
                height += b_each * dot(row(vertices, v), normal)
        out[e] = height / (size * np.sqrt(squares))


@kernel
def _adjacent(neighbors: Csr, i: Index, j: Index) -> bool:
    """Whether j is among the neighbours of i."""
    found = False
    for k in range(neighbors.indptr[i], neighbors.indptr[i + 1]):
        found |= neighbors.indices[k] == j
    return found


@kernel
def _spread(vertices: Vectors, neighbors: Csr, i: Index) -> float:
    """Mean of the squared distances of the neighbours."""
    total: float = 0.0
    first, last = neighbors.indptr[i], neighbors.indptr[i + 1]
    for k in range(first, last):
        total += squared_distance(row(vertices, neighbors.indices[k]), row(vertices, i))
    mean: float = total / (last - first)
    return mean
