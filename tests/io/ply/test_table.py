"""Rows of PLY files are found without a copy, and nothing beside positions and normals is changed."""

import tracemalloc

import numpy as np
import pytest
from sample_files import ply_binary, read, written

from cascadenorm import io


@pytest.mark.parametrize("order", "<>")
def test_binary_bytes_beside_positions_and_normals_stay(order):
    data = ply_binary(order)
    file = read(data)
    moved = written(file.with_vertices(file.mesh.vertices * 3))
    differ = np.flatnonzero(np.frombuffer(data, np.uint8) != np.frombuffer(moved, np.uint8))
    start = data.index(b"end_header\n") + 11 + 4
    rows = start + np.cumsum([0, *(36 + 1 + 2 * i for i in range(3))])
    assert len(data) == len(moved)
    assert all(any(row <= at < row + 36 for row in rows) for at in differ)
    # the face flags, lists, and the element after the faces lie behind all of that
    assert differ.max() < rows[-1] + 36


def test_lying_header_allocates_nothing():
    data = b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000\nproperty float x\nproperty float y\n"
    lists = b"property float z\nelement face 3\nproperty list uint int vertex_indices\nend_header\n"
    for lie in (data + lists + bytes(64), data.replace(b"1000000000000", b"3") + lists + bytes(36) + b"\xff" * 20):
        tracemalloc.start()
        with pytest.raises(io.ReadError):
            read(lie)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
        tracemalloc.stop()
