"""Clusters are connected, compact and of about the same area."""

import numpy as np
import pytest
import scipy
from shapes import cube, grid, icosphere, noisy

from cascadenorm.geometry.vertex_clusters import vertex_areas, vertex_clusters
from cascadenorm.mesh import Mesh, limit_threads, scatter_add

MESHES = {"ball": noisy(icosphere(4), 0.1), "sheet": grid(40, 50), "cube": cube(20)}


def clusters_of(mesh: Mesh, spacing: float) -> np.ndarray:
    return vertex_clusters(mesh, np.full(len(mesh.vertices), spacing))


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("edges", [0.3, 2.0, 5.0])
def test_clusters_are_connected_and_hold_every_vertex_once(name, edges):
    mesh = MESHES[name]
    labels = clusters_of(mesh, edges * mesh.mean_edge_length)
    np.testing.assert_array_equal(np.unique(labels), np.arange(labels.max() + 1))
    within = mesh.topology.edges[np.equal(*labels[mesh.topology.edges].T)]
    graph = scipy.sparse.coo_array((np.ones(len(within)), within.T), shape=(len(labels), len(labels)))
    assert scipy.sparse.csgraph.connected_components(graph, directed=False)[0] == labels.max() + 1
    if edges < 0.5:
        assert len(np.unique(labels)) == len(labels)


@pytest.mark.parametrize("name", MESHES)
def test_clusters_are_as_large_as_hexagons_of_the_spacing(name):
    mesh = MESHES[name]
    spacing = 5 * mesh.mean_edge_length
    labels = clusters_of(mesh, spacing)
    areas = scatter_add(labels, vertex_areas(mesh), int(labels.max()) + 1)
    assert areas.mean() == pytest.approx(np.sqrt(0.75) * spacing**2, rel=0.25)
    assert areas.std() < 0.3 * areas.mean()  # a random Voronoi diagram has 0.53


def test_a_vertex_is_nearer_to_its_own_centroid_than_to_those_around():
    mesh = MESHES["sheet"]
    labels = clusters_of(mesh, 5.0)
    sums = scatter_add(labels, vertex_areas(mesh)[:, None] * mesh.vertices, int(labels.max()) + 1)
    centroids = sums / scatter_add(labels, vertex_areas(mesh), int(labels.max()) + 1)[:, None]
    away = np.linalg.norm(mesh.vertices[:, None] - centroids, axis=2)
    own = np.take_along_axis(away, labels[:, None], axis=1)[:, 0]
    assert (own <= away.min(axis=1) + 0.5).mean() > 0.98  # a vertex at the border may be taken by either


def test_vertices_without_a_face_are_in_no_cluster():
    ball = icosphere(3)
    mesh = Mesh(np.concatenate([[[5.0, 0, 0]], ball.vertices, [[0, 0, 0]]]), ball.faces + 1)
    labels = clusters_of(mesh, 0.4)
    assert labels[0] == labels[-1] == -1
    np.testing.assert_array_equal(labels[1:-1], clusters_of(ball, 0.4))


def test_same_bytes_for_any_number_of_threads():
    found = []
    for threads in (1, 3):
        with limit_threads(threads):
            found.append(clusters_of(MESHES["ball"], 0.3).tobytes())
    assert found[0] == found[1]
