"""The memory of freed arrays."""

import os
import platform
from pathlib import Path

import numpy as np
import pytest

from cascadenorm.compute.freed_memory import RETURNED_BYTES, return_freed_memory


def resident() -> int:
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other systems return it themselves, or never")
def test_the_memory_of_freed_arrays_between_others_is_returned():
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
