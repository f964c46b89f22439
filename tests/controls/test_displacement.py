"""A limit of displacements also holds after rounding to the type of the result."""

import numpy as np
from shapes import icosphere, noisy

import cascadenorm as cn

BALL = noisy(icosphere(2), 0.2)
METHOD = {"method": "bilateral-normal"}


def test_limit_holds_where_rounding_is_coarser_than_the_limit():
    far = (BALL.vertices * 4 + 3e6).astype(np.float32)
    out = cn.denoise(far, BALL.faces, max_displacement=0.1, **METHOD)
    assert np.linalg.norm(out.astype(float) - far.astype(float), axis=1).max() <= 0.1
