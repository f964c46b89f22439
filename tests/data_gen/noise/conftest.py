"""What noise is added to."""

import numpy as np
import pytest

from cascadenorm.data_gen.meshing.lattice import sample
from cascadenorm.data_gen.meshing.polygonise import dual_contouring
from cascadenorm.data_gen.shapes.fields import sphere


@pytest.fixture(scope="module")
def ball():
    field, rng = sphere(radius=1), np.random.default_rng(0)
    return dual_contouring(field, sample(field, lower=[-1.1] * 3, upper=[1.1] * 3, spacing=0.06, jitter=0.1, rng=rng))
