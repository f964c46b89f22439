"""Damaged files and malformed meshes by the thousand: a result that holds what is promised, or an error of ours.

`-m slow` takes ten times as many; `python -m benchmarks.robustness.malformed random` goes on for hours.
"""

import time
import tracemalloc

import numpy as np
import pytest
from damage import damaged, denoised, read_damaged
from hypothesis import given, settings
from hypothesis import strategies as st
from sample_files import SAMPLES, SAMPLES_FORMAT

OTHERS = list(SAMPLES.values())
SECONDS, BYTES = 10, 50_000_000

seeds = st.integers(0, 2**32 - 1).map(np.random.default_rng)
few = settings(max_examples=40, derandomize=True, database=None)
many = settings(few, max_examples=400)
every_sample = pytest.mark.parametrize("name", SAMPLES)


def check_file(name: str, rng: np.random.Generator) -> None:
    """Read a damaged sample within bounds of time and memory."""
    start = time.process_time()
    tracemalloc.start()
    try:
        read_damaged(SAMPLES_FORMAT[name], SAMPLES[name], rng, OTHERS)
        assert tracemalloc.get_traced_memory()[1] < BYTES
    finally:
        tracemalloc.stop()
    assert time.process_time() - start < SECONDS


@every_sample
def test_damaged_files_are_read_or_refused(name):
    read_damaged(SAMPLES_FORMAT[name], SAMPLES[name], np.random.default_rng(0), OTHERS)  # kernels are compiled here
    few(given(seeds)(lambda rng: check_file(name, rng)))()


@pytest.mark.slow
@every_sample
def test_more_damaged_files_are_read_or_refused(name):
    many(given(seeds)(lambda rng: check_file(name, rng)))()


@settings(few, max_examples=200)
@given(seeds)
def test_adversarial_meshes_are_denoised_or_refused(rng):
    assert 0 < len(denoised(rng)) < 1000  # done, or a reason that can be read


@pytest.mark.slow
@settings(few, max_examples=2000)
@given(seeds)
def test_more_adversarial_meshes_are_denoised_or_refused(rng):
    assert 0 < len(denoised(rng)) < 1000  # done, or a reason that can be read


def test_damage_is_done_and_can_be_done_again():
    data = [damaged(OTHERS[0], OTHERS, np.random.default_rng(seed)) for seed in range(100)]
    assert len({*data, OTHERS[0]}) > 80
    assert data == [damaged(OTHERS[0], OTHERS, np.random.default_rng(seed)) for seed in range(100)]
