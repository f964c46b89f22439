"""Counts of passes, bytes and memory: no method becomes slower unnoticed, on whatever machine the tests run."""

import json

import numba
import numpy as np
import pytest
from shapes import icosphere, noisy

from benchmarks.speed import kernels as script
from cascadenorm import denoise
from cascadenorm.mesh import Csr

compiled_only = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="numpy scalars are counted as memory")


@compiled_only
@pytest.mark.parametrize("method", ["auto", "bilateral-normal", "taubin"])
def test_no_count_has_grown_since_the_last_record(method):
    recorded = json.loads(script.HISTORY.read_text(encoding="utf-8"))[-1]["counts"]
    found = {method: script.counted(script.wavy_torus(*script.COUNTED_SIZE), method)}
    assert script.grown(recorded, found) == []


def test_a_count_that_has_grown_is_named():
    before = {"auto": {"rows a face": 100.0, "bytes a face": 2000.0}}
    assert script.grown(before, {"auto": {"rows a face": 99.0, "bytes a face": 2000.0}}) == []
    more = script.grown(before, {"auto": {"rows a face": 101.0, "bytes a face": 2000.0}, "new": {"rows a face": 1.0}})
    assert more == ["auto: rows a face 100.0 -> 101.0"]


def test_kernels_are_watched_inside_the_block_alone():
    mesh = noisy(icosphere(2), 0.1)
    with script.watched() as uses:
        denoise(mesh, method="bilateral-normal", iterations=3, sweeps=2)
        seen = {name: use.rows for name, use in uses.items()}
    assert seen["baselines.bilateral_normal.bilateral_pass"] == 3 * len(mesh.faces)
    assert seen["baselines.vertex_update.sweep_range"] == 2 * len(mesh.vertices)
    assert all(use.seconds >= 0 and use.bytes > 0 for use in uses.values())
    denoise(mesh, method="bilateral-normal")
    assert {name: use.rows for name, use in uses.items()} == seen


def test_a_pass_moves_each_array_once_and_as_far_as_it_goes():
    points, rows = np.zeros((10, 3)), Csr(np.zeros(11, np.int64), np.zeros(40, np.int32))
    assert script.least_bytes(10, (points, points, rows)) == 240 + 88 + 160
    assert script.least_bytes(5, (points, points, rows)) == (240 + 88 + 160) / 2
