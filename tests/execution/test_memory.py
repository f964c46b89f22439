"""The memory that a block of code takes."""

import sys

import numpy as np
import pytest

from cascadenorm.execution.memory import peak_memory


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the system does not tell")
def test_the_memory_of_a_block_is_what_it_touched():
    with peak_memory() as peak:
        np.ones(25_000_000)
    assert peak.megabytes == pytest.approx(200, rel=0.1)
    with peak_memory() as peak:
        np.ones(1000)
    assert peak.megabytes < 20
