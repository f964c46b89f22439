"""Connected components of graphs, and fans of face corners."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from scipy import sparse

from cascadenorm.compute.arrays import first_of_each
from cascadenorm.mesh import Mesh, connected_components

graphs = st.integers(1, 40).flatmap(
    lambda count: st.tuples(st.lists(st.tuples(*[st.integers(0, count - 1)] * 2), max_size=60), st.just(count))
)


@given(graphs)
def test_components_are_those_of_scipy_in_the_order_of_first_nodes(graph):
    links, count = np.array(graph[0], np.int64).reshape(-1, 2), graph[1]
    matrix = sparse.coo_array((np.ones(len(links)), (links[:, 0], links[:, 1])), (count, count))
    expected = sparse.csgraph.connected_components(matrix, directed=False)[1]
    assert_array_equal(connected_components(links, count), expected)


def test_without_nodes_there_are_no_components():
    assert len(connected_components(np.empty((0, 2), np.int32), 0)) == 0


def test_the_first_place_of_each_label_is_that_of_numpy():
    labels = np.array([0, 2, 0, 1, 2, 2, 1, 3])
    assert_array_equal(first_of_each(labels), np.unique(labels, return_index=True)[1])
    assert len(first_of_each(labels[:0])) == 0


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
