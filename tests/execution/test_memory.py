"""The memory that a block of code takes."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from cascadenorm.execution.memory import RETURNED_BYTES, peak_memory, return_freed_memory


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the system does not tell")
def test_the_memory_of_a_block_is_what_it_touched():
    with peak_memory() as peak:
        np.ones(25_000_000)
    assert peak.megabytes == pytest.approx(200, rel=0.1)
    with peak_memory() as peak:
        np.ones(1000)
    assert peak.megabytes < 20


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems return it themselves, or never")
def test_the_memory_of_freed_arrays_between_others_is_returned():
    def resident():
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")

    np.ones(3_500_000)  # from now on, glibc keeps freed arrays up to this size
    arrays = [np.ones(125_000) for _ in range(200)]
    kept = arrays[9::10]
    del arrays
    before = resident()
    return_freed_memory(RETURNED_BYTES - 1)
    assert resident() == pytest.approx(before, abs=5e6)
    return_freed_memory(RETURNED_BYTES)
    assert resident() < before - 100e6
    assert len(kept) == 20
