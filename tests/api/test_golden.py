"""No method gives other answers than it did: faster may not mean different."""

import json

import golden
import numpy as np
import pytest
from numba import config

from cascadenorm.registry import registered

RECORDED = json.loads(golden.RECORD.read_text(encoding="utf-8"))
TOLERANCE = 1e-5
"""Mean edge lengths; processors and versions of BLAS differ by up to 2e-6 in `auto`, by less in other methods."""


LONG = {("spectral", "sphere, 20,480 faces")}  # the eigenvectors of a large matrix
CASES = [
    pytest.param(method, size, id=f"{method}-{size}", marks=[pytest.mark.slow] if (method, size) in LONG else [])
    for size in golden.MESHES
    for method in registered()
]


@pytest.mark.skipif(config.DISABLE_JIT, reason="loops of Python take too long")
@pytest.mark.parametrize(("method", "size"), CASES)
def test_a_method_gives_the_answers_that_were_recorded(method, size):
    np.testing.assert_allclose(golden.digest(method, golden.made(size)), RECORDED[size][method], atol=TOLERANCE, rtol=0)
