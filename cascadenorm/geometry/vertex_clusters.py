"""Clustering of vertices as in a centroidal Voronoi diagram."""

import numpy as np

from cascadenorm.mesh import Csr, Floats, Ints, Ints32, Mesh, Vectors, connected_components, kernel, marked
from cascadenorm.mesh.vectors import row, squared_distance

RADIUS = 0.7
"""Least distance between seeds, divided by the mean distance between centroids.

In random sequential packing, discs lie √(0.91/0.55) = 1.29 times as far apart as in the densest packing. The value 0.7
instead of 1/1.29 compensates for boundaries and for the discrete steps."""
CLUSTER_PASSES = 30  # largest number of passes over the edges in which vertices change their cluster
SETTLED = 0.001  # convergence criterion: fraction of the vertices that change their cluster in a pass


def vertex_clusters(mesh: Mesh, spacing: Floats) -> Ints32:
    """Divide the vertices into connected clusters; return the (n,) cluster of each, -1 for vertices without a face.

    The spacing, (n,), is the distance between the centroids around each vertex, in mesh units. Seeds are chosen at
    random, at least RADIUS spacings apart, and claim the vertices around them. Then vertices at the border of a cluster
    move to the neighbouring cluster if this reduces the sum of squared distances to the centroids (Valette, Chassery
    2004). The cost does not depend on the number of clusters.
    """
    topology = mesh.topology
    around = topology.vertex_neighbors
    labels = np.full(len(mesh.vertices), -1, np.int32)
    order = np.random.default_rng(0).permutation(np.flatnonzero(topology.used_vertices))
    _seed(mesh.vertices, around, order, RADIUS * spacing, labels)
    weights = vertex_areas(mesh)
    _relax(mesh.vertices, weights, topology.edges, labels, CLUSTER_PASSES, SETTLED)
    return _connected(labels, topology.edges, around)


def vertex_areas(mesh: Mesh) -> Floats:
    """Return the (n,) third of the area around each vertex, but at least a thousandth of the mean."""
    areas = mesh.sums_around(mesh.areas / 3)
    least = 1e-3 * areas.sum() / max(np.count_nonzero(mesh.topology.used_vertices), 1)
    return np.maximum(areas, max(least, np.finfo(float).tiny))


def _connected(labels: Ints32, edges: Ints32, around: Csr) -> Ints32:
    """Keep the largest connected piece of each cluster, assign other pieces to neighbours, and renumber."""
    labels, inside = labels.copy(), labels >= 0
    pieces = connected_components(edges[labels[edges[:, 0]] == labels[edges[:, 1]]], len(labels))
    sizes = np.bincount(pieces)
    owners = np.empty(len(sizes), np.int32)
    owners[pieces] = labels
    by_size = np.lexsort((-sizes, owners))  # stable, so that ties go to the first piece
    _, first = np.unique(owners[by_size], return_index=True)
    cut_off = inside & ~marked(by_size[first], len(sizes))[pieces]
    labels[cut_off] = -1
    _assign_free(labels, np.flatnonzero(cut_off), around)
    _, numbers = np.unique(labels[inside], return_inverse=True)
    labels[inside] = numbers.ravel()
    return labels


@kernel
def _seed(vertices: Vectors, around: Csr, order: Ints, radius: Floats, labels: Ints32) -> None:
    """Make each unreached vertex a seed; it claims the vertices in its radius that no earlier seed is nearer to."""
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
    """Move the ends of edges between two clusters to the other cluster if this reduces the energy.

    A cluster with weights w at positions x has the energy Σ w x² - |Σ w x|²/Σ w; the total of the first terms is
    constant.
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
    """Return |Σ w x|²/Σ w of a cluster after adding a vertex, or removing it with a negative weight."""
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
def _assign_free(labels: Ints32, free: Ints, around: Csr) -> None:
    """Assign free vertices, in rounds, to the cluster of their first neighbour that has one."""
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
