"""A lattice holds the exact values of a field near its surface."""

import numpy as np
from distance_fields import CUBE, lattice_of


def test_skipping_blocks_changes_nothing():
    field = CUBE
    lattice = lattice_of(field, 0.08, jitter=0.2)
    full = field(lattice.nodes.reshape(-1, 3)).reshape(lattice.values.shape)
    near = np.abs(full) < 0.2
    np.testing.assert_array_equal(lattice.values[near], full[near])
    np.testing.assert_array_equal(np.sign(lattice.values), np.sign(full))
