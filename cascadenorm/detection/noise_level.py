"""Noise estimation from the mesh alone."""

from statistics import NormalDist

import numpy as np

from cascadenorm.mesh import (
    Bools,
    Csr,
    Floats,
    Index,
    Ints32,
    Mesh,
    Vectors,
    any_in_rows,
    kernel,
    marked,
    parallel_for,
    scatter_add,
)
from cascadenorm.mesh.averages import averaged
from cascadenorm.mesh.topology import rows_with
from cascadenorm.mesh.vectors import add, dot, length, row, squared_distance

SAMPLES = 50_000  # edges used, evenly spaced in order
FEWEST_EDGES = 30  # edges required for an estimate
START = 0.2  # fraction of the differences, the smallest ones, that is assumed to contain no creases
CLIP = 1.5  # standard deviations beyond which a difference may belong to a crease
_NORMAL = NormalDist()
KEPT_VARIANCE = 1 - 2 * CLIP * _NORMAL.pdf(CLIP) / (2 * _NORMAL.cdf(CLIP) - 1)  # of a Gaussian truncated at CLIP
CLIPPING_ROUNDS = 50


def noise_level(mesh: Mesh) -> float | None:
    """Estimate the standard deviation of the noise along the normal, in mean edge lengths of the noisy mesh.

    Let h_i = <x_i - mean_j x_j, n> be the height of vertex i above the mean of its neighbours, and s_i the mean of
    their squared distances. On a smooth surface h_i / s_i is half the mean curvature and therefore hardly differs
    between adjacent vertices, whether the mesh is regular or not. The remaining difference is noise: for an edge ij,

        e = s (h_i / s_i - h_j / s_j),    s = (s_i + s_j) / 2

    is a weighted sum of heights. On a plane, its variance is the noise variance times the sum of the squared weights.
    Each e is divided by the root of that sum, so that the standard deviation of e is that of the noise. It is computed
    by iterative clipping at CLIP standard deviations, starting from the smallest differences, so that creases have
    little effect.

    The estimate is accurate within 25 % from 0.05 to 0.5 if less than a third of the edges are near creases, and below
    0.02 for clean, smooth surfaces. Detail at the scale of the edges is indistinguishable from noise. Noise that is
    correlated between adjacent vertices, as in a smoothed scan, is not detected. The estimate is None if there are too
    few edges away from the boundary.
    """
    deviation = _deviation_along(mesh, _inner_edges(mesh))
    return None if np.isnan(deviation) else deviation / mesh.mean_edge_length


def component_noise(mesh: Mesh, wanted: Bools) -> Floats:
    """Estimate the noise of the wanted components, a mask (c,), each by itself: (c,), as lengths.

    The estimate is that of `noise_level`; NaN for other components and for those with too few edges.
    """
    edges = _inner_edges(mesh)
    within = rows_with(mesh.topology.components[edges[:, :1]], len(wanted))
    deviations = np.full(len(wanted), np.nan)
    for c in np.flatnonzero(wanted).tolist():
        deviations[c] = _deviation_along(mesh, edges[within.row(c)])
    return deviations


def local_noise(mesh: Mesh) -> Floats:
    """Estimate the noise along the normal around each vertex, (n,), in mean edge lengths of the mesh.

    The estimate is the root mean square of the differences described in `noise_level`, over the edges of a vertex and
    its neighbours; NaN if all of these are at a boundary. Creases are not excluded.
    """
    edges = _inner_edges(mesh)
    squares = np.square(_differences_along(mesh, edges)) if len(edges) else np.empty(0)
    known = np.isfinite(squares)
    edges, squares, count = edges[known], squares[known], len(mesh.vertices)
    total = scatter_add(edges.ravel(), np.repeat(squares, 2), count)
    number = np.bincount(edges.ravel(), minlength=count).astype(np.float64)
    total, number = (averaged(values, mesh.topology.vertex_neighbors, 1) for values in (total, number))
    variance = np.divide(total, number, out=np.full(count, np.nan), where=number > 0)
    return np.asarray(np.sqrt(variance) / mesh.mean_edge_length)


def _deviation_along(mesh: Mesh, edges: Ints32) -> float:
    """Return the standard deviation of the noise, as a length, along some of the edges; NaN if there are too few."""
    if len(edges) < FEWEST_EDGES:
        return np.nan
    edges = edges[np.linspace(0, len(edges) - 1, min(SAMPLES, len(edges))).astype(np.int64)]
    differences = _differences_along(mesh, edges)
    known = differences[np.isfinite(differences)]
    return _clipped_deviation(known) if len(known) >= FEWEST_EDGES else np.nan


def _differences_along(mesh: Mesh, edges: Ints32) -> Floats:
    """Return the normalised difference e of each edge; NaN if all neighbours of an end coincide with it."""
    around = mesh.topology.vertex_neighbors
    differences = np.empty(len(edges))
    vectors = mesh.vertex_area_vectors  # independent of the positions of the vertices themselves
    parallel_for(len(edges), _differences, mesh.vertices, vectors, edges, around, differences)
    return differences


def _inner_edges(mesh: Mesh) -> Ints32:
    """Return the interior edges without an end on a boundary or non-manifold edge."""
    edges, inner = mesh.topology.edges, mesh.topology.edge_faces.counts == 2
    on_border = marked(edges[~inner], len(mesh.vertices))
    return np.asarray(edges[inner & ~any_in_rows(on_border[edges])])


def _clipped_deviation(differences: Floats) -> float:
    """Return the standard deviation of the zero-mean Gaussian that fits the smaller differences."""
    sizes = np.abs(differences)
    deviation = float(np.quantile(sizes, START) / _NORMAL.inv_cdf(0.5 + START / 2))
    for _ in range(CLIPPING_ROUNDS):
        within = sizes[sizes <= CLIP * deviation]
        closer = float(np.sqrt(np.square(within).mean() / KEPT_VARIANCE)) if len(within) else 0.0
        if closer == deviation:
            break
        deviation = closer
    return deviation


@kernel
def _differences(
    start: int, stop: int, vertices: Vectors, vectors: Vectors, edges: Ints32, neighbors: Csr, out: Floats
) -> None:
    """Compute the differences of edges start … stop with scalar arithmetic only, so that the kernel loads quickly."""
    for e in range(start, stop):
        i, j = edges[e, 0], edges[e, 1]
        normal = add(row(vectors, i), row(vectors, j))
        size = length(normal)
        spread_i, spread_j = _spread(vertices, neighbors, i), _spread(vertices, neighbors, j)
        # undefined without a normal or with all neighbours in one place
        if size == 0 or spread_i == 0 or spread_j == 0:
            out[e] = np.nan
            continue
        a, b = 0.5 + 0.5 * spread_j / spread_i, 0.5 + 0.5 * spread_i / spread_j
        a_each = a / (neighbors.indptr[i + 1] - neighbors.indptr[i])
        b_each = b / (neighbors.indptr[j + 1] - neighbors.indptr[j])
        at_i, at_j = a + b_each, -b - a_each
        # height is the weighted sum of positions along the normal, squares the sum of the squared weights
        squares = at_i * at_i + at_j * at_j
        height = at_i * dot(row(vertices, i), normal) + at_j * dot(row(vertices, j), normal)
        # neighbours of i, including common ones, then the remaining neighbours of j
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
    found = False
    for k in range(neighbors.indptr[i], neighbors.indptr[i + 1]):
        found |= neighbors.indices[k] == j
    return found


@kernel
def _spread(vertices: Vectors, neighbors: Csr, i: Index) -> float:
    """Return the mean squared distance of the neighbours."""
    total: float = 0.0
    first, last = neighbors.indptr[i], neighbors.indptr[i + 1]
    for k in range(first, last):
        total += squared_distance(row(vertices, neighbors.indices[k]), row(vertices, i))
    mean: float = total / (last - first)
    return mean
