"""Connected components of a graph."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.compute.arrays import Ints32
from cascadenorm.compute.kernels import kernel


def connected_components(links: NDArray[Any], count: int) -> Ints32:
    """Return the (count,) component of each node of a graph, given by pairs of connected nodes, (k, 2).

    Components are numbered in the order of their first nodes.
    """
    labels = np.empty(count, np.int32)
    _label(np.ascontiguousarray(links, np.int32), labels)
    return labels


@kernel
def root_of(labels: Ints32, node: np.int32) -> np.int32:
    """Return the root of a node's union-find tree, halving the path to it; each label is at most its node."""
    while labels[node] != node:
        labels[node] = labels[labels[node]]
        node = labels[node]
    return node


@kernel
def _label(links: Ints32, labels: Ints32) -> None:
    """Find components by union-find: until the last loop, each label is the node itself or a lower node."""
    for i in range(len(labels)):
        labels[i] = i
    for k in range(len(links)):
        a, b = root_of(labels, links[k, 0]), root_of(labels, links[k, 1])
        labels[max(a, b)] = min(a, b)
    count = 0
    for i in range(len(labels)):
        if labels[i] == i:
            labels[i] = count
            count += 1
        else:
            labels[i] = labels[labels[i]]
