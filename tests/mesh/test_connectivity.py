"""Connected components of graphs."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from scipy import sparse

from cascadenorm.mesh import connected_components

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
