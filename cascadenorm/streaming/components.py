"""Connected components of a mesh on disk."""

import numpy as np
from numpy.typing import NDArray

from cascadenorm.mesh import Ints32, kernel
from cascadenorm.mesh.connectivity import root_of
from cascadenorm.streaming.layers import Layer
from cascadenorm.streaming.store import Store


def write_components(store: Store, layer: Layer) -> int:
    """Write the connected component of each vertex; return how many there are.

    They are numbered by their first vertices, from 0 on. A vertex without a face is in none, and gets 0. While it works
    it keeps 4 bytes of each vertex in memory.
    """
    leads = np.arange(store.tables.vertices.rows, dtype=np.int32)
    used = np.zeros(len(leads), bool)
    tiles = [tile for number in range(store.whole.patches) for tile in range(*store.tiles_of(number))]
    for tile in tiles:
        corners = store.rows(tile)[1].astype(np.int32)
        used[corners] = True
        _unite(corners, leads)
    count = _number(leads, used)
    for tile in tiles:
        layer.write(tile, tile + 1, leads[store.rows(tile)[0]])
    return int(count)


@kernel
def _unite(faces: Ints32, leads: Ints32) -> None:
    """Let the vertices of each face lead to one, the least of their component, over others."""
    for f in range(len(faces)):
        a = root_of(leads, faces[f, 0])
        for corner in range(1, 3):
            b = root_of(leads, faces[f, corner])
            low, high = min(a, b), max(a, b)
            leads[high] = low
            a = low


@kernel
def _number(leads: Ints32, used: NDArray[np.bool_]) -> int:
    """Replace what each vertex leads to by the number of its component; return how many there are."""
    count = 0
    for vertex in range(len(leads)):  # which leads to a lower one, or to itself
        if not used[vertex]:
            leads[vertex] = 0
        elif leads[vertex] == vertex:
            leads[vertex] = count
            count += 1
        else:
            leads[vertex] = leads[leads[vertex]]
    return count
