"""A mesh that several files of tests write."""

import numpy as np
import pytest

from cascadenorm import io


@pytest.fixture
def tetrahedron():
    return io.from_arrays(np.eye(4)[:, :3], [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)])
