"""Vertices in clusters of about equal size, as in a centroidal Voronoi diagram of the surface."""

import numpy as np

from cascadenorm.mesh import Csr, Floats, Ints, Ints32, Mesh, Vectors, kernel
from cascadenorm.mesh.vectors import row, squared_distance

RADIUS = 0.7
"""Least distance of two seeds over the mean distance of the centroids. Discs thrown at random until no further one fits
lie √(0.91/0.55) = 1.29 times as far apart; 0.7 instead of 1/1.29 makes up for the boundaries and for the steps."""
CLUSTER_PASSES = 30
"""Passes over the edges, at most, in which vertices change their cluster."""
SETTLED = 0.001
"""Share of the vertices that change in a pass, below which the clusters count as settled."""


def vertex_clusters(mesh: Mesh, spacing: Floats) -> Ints32:
    """Divide the vertices into connected clusters whose centroids lie a given distance apart.

    Seeds are thrown at random, none of them nearer than RADIUS spacings to one before, and take the vertices around
    them. Then a vertex at the border of a cluster changes to the neighbouring one where that makes
    the sum of the squared distances to the centroids smaller (Valette, Chassery 2004). Each step visits a vertex a few
    times, however many clusters there are.

    Parameters
    ----------
    mesh
        Mesh with n vertices.
    spacing
        (n,) distance between the centroids around each vertex, in the unit of the mesh, above 0.

    Returns
    -------
    (n,) number of the cluster of each vertex; -1 for vertices without a face.
    """
    topology = mesh.topology
    around = topology.vertex_neighbors
    labels = np.full(len(mesh.vertices), -1, np.int32)
    order = np.random.default_rng(0).permutation(np.flatnonzero(topology.used_vertices))
    _seed(mesh.vertices, around, order, RADIUS * spacing, labels)
    weights = vertex_areas(mesh)
    _relax(mesh.vertices, weights, topology.edges, labels, CLUSTER_PASSES, SETTLED)
    return _connected(labels, around)


def vertex_areas(mesh: Mesh) -> Floats:
    """Return a third of the area around each vertex, (n,), and not less than a thousandth of the mean."""
    areas = mesh.sums_around(mesh.areas[:, None] / 3)[:, 0]
    least = 1e-3 * areas.sum() / max(np.count_nonzero(mesh.topology.used_vertices), 1)
    return np.maximum(areas, max(least, np.finfo(float).tiny))


def _connected(labels: Ints32, around: Csr) -> Ints32:
    """Keep the largest connected piece of each cluster, let its neighbours take the others, and number the clusters."""
    labels = labels.copy()
    pieces = np.empty(len(labels), np.int32)
    sizes = np.empty(len(labels), np.int64)
    count = _pieces(labels, around, pieces, sizes)
    inside = labels >= 0
    clusters = labels.max() + 1
    largest = np.full(clusters, -1, np.int32)
    _largest_pieces(labels, pieces, sizes[:count], largest)
    cut_off = inside & (largest[labels] != pieces)
    labels[cut_off] = -1
    _take(labels, np.flatnonzero(cut_off), around)
    _, numbers = np.unique(labels[inside], return_inverse=True)
    labels[inside] = numbers.ravel()
    return labels


@kernel
def _seed(vertices: Vectors, around: Csr, order: Ints, radius: Floats, labels: Ints32) -> None:
    """Make each vertex that no seed has reached a seed; it takes what is nearer to it than to those before."""
    squared = np.full(len(vertices), np.inf)
    stack = np.empty(len(vertices), np.int64)
    count = 0
    for seed in order:
        if labels[seed] >= 0:
            continue
        labels[seed], squared[seed], stack[0], top = count, 0.0, seed, 1
        place, farthest = row(vertices, seed), radius[seed] * radius[seed]
        while top > 0:
            top -= 1
            i = stack[top]
            for k in range(around.indptr[i], around.indptr[i + 1]):
                j = around.indices[k]
                if labels[j] == count:
                    continue
                distance = squared_distance(row(vertices, j), place)
                if distance < farthest and distance < squared[j]:
                    labels[j], squared[j], stack[top] = count, distance, j
                    top += 1
        count += 1


@kernel
def _relax(vertices: Vectors, weights: Floats, edges: Ints32, labels: Ints32, passes: int, settled: float) -> None:
    """Let the ends of edges between two clusters change to the other one where the energy becomes smaller.

    Of a cluster with weights w at places x the energy is Σ w x² - |Σ w x|²/Σ w, of which the first sum stays.
    """
    count = 0
    for i in range(len(labels)):
        count = max(count, labels[i] + 1)
    totals, members = np.zeros((count, 4)), np.zeros(count, np.int64)
    for i in range(len(labels)):
        if labels[i] >= 0:
            members[labels[i]] += 1
            totals[labels[i], 3] += weights[i]
            for d in range(3):
                totals[labels[i], d] += weights[i] * vertices[i, d]
    for _ in range(passes):
        changed = 0
        for e in range(len(edges)):
            u, v = edges[e]
            a, b = labels[u], labels[v]
            if a == b:
                continue
            now = _gain(totals, a, vertices, u, 0.0) + _gain(totals, b, vertices, v, 0.0)
            to_b = to_a = -np.inf
            if members[a] > 1:
                to_b = _gain(totals, a, vertices, u, -weights[u]) + _gain(totals, b, vertices, u, weights[u])
            if members[b] > 1:
                to_a = _gain(totals, a, vertices, v, weights[v]) + _gain(totals, b, vertices, v, -weights[v])
            if max(to_a, to_b) > now * (1 + 1e-12):
                moved, old, new = (u, a, b) if to_b > to_a else (v, b, a)
                labels[moved] = new
                members[old] -= 1
                members[new] += 1
                totals[old, 3] -= weights[moved]
                totals[new, 3] += weights[moved]
                for d in range(3):
                    totals[old, d] -= weights[moved] * vertices[moved, d]
                    totals[new, d] += weights[moved] * vertices[moved, d]
                changed += 1
        if changed <= settled * len(labels):
            return


@kernel
def _gain(totals: Floats, cluster: int, vertices: Vectors, i: int, weight: float) -> float:
    """|Σ w x|²/Σ w of a cluster after a vertex has come to it, or gone with a negative weight."""
    total = totals[cluster, 3] + weight
    if not total > 0.0:
        return -np.inf
    squares = 0.0
    for d in range(3):
        part = totals[cluster, d] + weight * vertices[i, d]
        squares += part * part
    gain: float = squares / total
    return gain


@kernel
def _pieces(labels: Ints32, around: Csr, pieces: Ints32, sizes: Ints) -> int:
    """Number the connected pieces of clusters, and count their vertices; returns how many pieces there are."""
    pieces[:] = -1
    stack = np.empty(len(labels), np.int64)
    count = 0
    for first in range(len(labels)):
        if labels[first] < 0 or pieces[first] >= 0:
            continue
        pieces[first], stack[0], top, size = count, first, 1, 1
        while top > 0:
            top -= 1
            i = stack[top]
            for k in range(around.indptr[i], around.indptr[i + 1]):
                j = around.indices[k]
                if labels[j] == labels[first] and pieces[j] < 0:
                    pieces[j], stack[top] = count, j
                    top += 1
                    size += 1
        sizes[count] = size
        count += 1
    return count


@kernel
def _largest_pieces(labels: Ints32, pieces: Ints32, sizes: Ints, largest: Ints32) -> None:
    """Find the piece of each cluster with the most vertices; among equals the first."""
    for i in range(len(labels)):
        c = labels[i]
        if c >= 0 and (largest[c] < 0 or sizes[pieces[i]] > sizes[largest[c]]):
            largest[c] = pieces[i]


@kernel
def _take(labels: Ints32, free: Ints, around: Csr) -> None:
    """Give free vertices the cluster of a neighbour that has one, in rounds, the first neighbour's."""
    left = len(free)
    while left > 0:
        taken = 0
        for f in range(left):
            i, label = free[f], -1
            for k in range(around.indptr[i], around.indptr[i + 1]):
                if labels[around.indices[k]] >= 0:
                    label = labels[around.indices[k]]
                    break
            if label >= 0:
                labels[i] = label
                taken += 1
            else:
                free[f - taken] = i
        left -= taken
