"""Neighbours of vertices, edges and faces, and their connected components, are those of the definitions."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from scipy import sparse
from shapes import icosphere, noisy

from cascadenorm.mesh import Mesh, connected_components
from cascadenorm.mesh.topology_kernels import MOST_AROUND

BALL = noisy(icosphere(2), 0.1)
graphs = st.integers(1, 40).flatmap(
    lambda count: st.tuples(st.lists(st.tuples(*[st.integers(0, count - 1)] * 2), max_size=60), st.just(count))
)


def row(rings, face: int) -> list[int]:
    return rings.indices[rings.indptr[face] : rings.indptr[face + 1]].tolist()


def test_three_faces_at_an_edge_are_no_pair():
    vertices = np.random.default_rng(0).normal(size=(6, 3))
    book = Mesh(vertices, [(0, 1, 2), (1, 0, 3), (0, 1, 4), (1, 2, 5)])
    assert book.topology.face_pairs.tolist() == [[0, 3]]
    assert book.topology.faces_across.tolist() == [[-1, 3, -1], [-1] * 3, [-1] * 3, [0, -1, -1]]


def test_across_and_back():
    sphere = icosphere(2)
    across = sphere.topology.faces_across
    assert (across >= 0).all() and (np.sort(across[across[:, 0]], axis=1) == np.arange(320)[:, None]).any(axis=1).all()
    shared = [set(sphere.faces[f]) & set(sphere.faces[across[f, side]]) for f in range(320) for side in range(3)]
    expected = [{sphere.faces[f, side], sphere.faces[f, (side + 1) % 3]} for f in range(320) for side in range(3)]
    assert shared == expected


def leaves(count: int) -> Mesh:
    """Return faces that all share the edge from vertex 0 to vertex 1, like the leaves of a book."""
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    around = np.stack([np.cos(angles), np.sin(angles), np.full(count, 0.5)], axis=1)
    corners = np.stack([np.zeros(count), np.ones(count), np.arange(count) + 2], axis=1)
    return Mesh(np.vstack([[[0, 0, 0], [0, 0, 1]], around]), corners.astype(int))


def test_all_faces_around_a_vertex_are_neighbours():
    topology = leaves(MOST_AROUND + 1).topology
    rings = topology.face_rings(1)
    for f in (0, 60, MOST_AROUND):
        assert sorted(row(rings, f)) == sorted(set(range(MOST_AROUND + 1)) - {f})


@pytest.mark.compiled
def test_neighbourhoods_grow_with_the_number_of_faces_on_an_edge_and_not_with_its_square():
    sizes = [len(leaves(count).topology.face_rings(1).indices) for count in (1000, 2000, 4000)]
    assert sizes[0] <= 1000 * 2 * MOST_AROUND
    assert sizes[2] - sizes[1] == 2 * (sizes[1] - sizes[0]) == 2000 * 2 * MOST_AROUND


def test_bounded_neighbourhoods_are_mutual_and_those_of_a_part_of_the_mesh():
    whole = leaves(1000)
    rings = whole.topology.face_rings(1)
    neighbors = [set(row(rings, f)) for f in range(1000)]
    assert neighbors[500] == set(range(500 - MOST_AROUND, 501 + MOST_AROUND)) - {500}
    assert all(f in neighbors[g] for f in range(1000) for g in neighbors[f])

    # the order of the faces is that of the whole mesh, and all neighbours of face 500 are there
    kept = np.array(sorted({3, 90, 900} | neighbors[500] | {500}))
    part = Mesh(whole.vertices, whole.faces[kept]).topology.face_rings(1)
    assert set(kept[row(part, int(np.searchsorted(kept, 500)))]) == neighbors[500]


@pytest.mark.compiled
def test_the_second_ring_is_the_union_of_the_neighbours_of_the_first():
    rings = [leaves(300).topology.face_rings(ring) for ring in (1, 2)]
    first = [set(row(rings[0], f)) for f in range(300)]
    assert set(row(rings[1], 150)) == set().union(*(first[g] for g in first[150])) - {150}


def test_forgetting_adjacent_faces_keeps_the_vertices_around_each_vertex():
    topology = icosphere(2).topology
    rings, across, pairs = topology.face_rings(1), topology.faces_across, topology.face_pairs
    neighbors = topology.vertex_neighbors
    topology.forget_adjacent_faces()
    assert not {"edge_faces", "interior_edges", "face_pairs", "faces_across"} & set(vars(topology))
    assert topology.vertex_neighbors is neighbors
    assert topology.face_rings(1) is not rings
    np.testing.assert_array_equal(topology.face_rings(1).indices, rings.indices)
    np.testing.assert_array_equal(topology.faces_across, across)
    np.testing.assert_array_equal(topology.face_pairs, pairs)


def test_no_face_has_two_vertices_of_one_color():
    rng = np.random.default_rng(0)
    soup = rng.integers(0, 300, (800, 3)).astype(np.int32)  # repeated corners and non-manifold edges among them
    for faces in (BALL.faces, soup):
        topology = Mesh(np.zeros((300, 3)), faces).topology
        color = np.full(300, -1)
        color[topology.vertex_colors.indices] = topology.vertex_colors.rows
        np.testing.assert_array_equal(color >= 0, topology.used_vertices)
        assert len(topology.vertex_colors.indices) == topology.used_vertices.sum()
        sides = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        ends = color[sides[sides[:, 0] != sides[:, 1]]]
        assert (ends[:, 0] != ends[:, 1]).all()


def test_edges_are_listed_once_and_in_order_whatever_the_faces():
    for seed, (vertices, faces) in enumerate([(300, 800), (5, 60), (40, 3000), (1, 2)]):
        rows = np.random.default_rng(seed).integers(0, vertices, (faces, 3))
        topology = Mesh(np.zeros((vertices, 3)), rows).topology
        sides = np.stack([rows, np.roll(rows, -1, axis=1)], axis=2)
        expected = sorted({(min(side), max(side)) for side in sides.reshape(-1, 2).tolist()})
        assert topology.edges.tolist() == [list(edge) for edge in expected]
        np.testing.assert_array_equal(topology.edges[topology.face_edges], np.sort(sides, axis=2))


@given(graphs)
def test_components_are_those_of_scipy_in_the_order_of_first_nodes(graph):
    links, count = np.array(graph[0], np.int64).reshape(-1, 2), graph[1]
    matrix = sparse.coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), (count, count))
    expected = sparse.csgraph.connected_components(matrix, directed=False)[1]
    assert_array_equal(connected_components(links, count), expected)


def test_without_nodes_there_are_no_components():
    assert len(connected_components(np.empty((0, 2), np.int32), 0)) == 0


@given(st.lists(st.tuples(*[st.integers(0, 5)] * 3), min_size=1, max_size=12))
def test_fans_connect_corners_at_the_ends_of_an_edge_in_faces_that_follow_each_other_there(rows):
    topology = Mesh(np.eye(6, 3), rows).topology
    across = np.arange(len(topology.edges)) % 3 > 0
    for chosen in (across, None):
        links = []
        for edge in range(len(topology.edges)) if chosen is None else np.flatnonzero(across):
            ends = []
            for face, side in np.argwhere(topology.face_edges == edge):
                corners = [(rows[face][k % 3], 3 * face + k % 3) for k in (side, side + 1)]
                ends.append([corner for _, corner in sorted(corners, key=lambda corner: corner[0])])
            links += [link for one, other in pairwise(ends) for link in zip(one, other, strict=True)]
        expected = connected_components(np.array(links, np.int32).reshape(-1, 2), 3 * len(rows))
        assert_array_equal(topology.fans(chosen), expected)
