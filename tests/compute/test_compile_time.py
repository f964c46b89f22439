"""A first run says that it compiles, and reports the time of the method alone."""

import json
import os
import subprocess
import sys

import numba
import pytest
from shapes import icosphere, noisy

from cascadenorm.compute.compile_time import NOTICE, Stopwatch, _clock, tell_of_compiling
from cascadenorm.io.interop import save_mesh

compiled = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")


@compiled
def test_the_first_run_says_that_it_compiles_and_does_not_count_it(tmp_path):
    save_mesh(tmp_path / "ball.ply", noisy(icosphere(2), 0.2))
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kept"), "NUMBA_DISABLE_JIT": "0"}
    code = """
import atexit, sys
from cascadenorm.cli import main
from cascadenorm.compute.compile_time import _clock
atexit.register(lambda: print(_clock.seconds, file=sys.stderr))
main(["denoise", "ball.ply", "--method", "laplacian", "--force", "--json"])
"""
    found = []
    for _ in range(2):
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        *said, seconds = done.stderr.splitlines()
        found.append((said, float(seconds), json.loads(done.stdout)["seconds"]))
    (first, compiling, method), (second, none, _) = found
    assert first == [f"cascadenorm: {NOTICE}"] and second == []
    assert method < compiling and none == 0.0


def test_a_stopwatch_leaves_out_what_was_compiled_and_counts_nested_kernels_once(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("cascadenorm.compute.compile_time.time.perf_counter", lambda: now[0])
    said = []
    tell_of_compiling(said.append)
    watch = Stopwatch()
    for begins, ends in (((1.0, 2.0), (3.0, 6.0)), ((7.0,), (8.5,))):  # one that compiles another, then one alone
        for now[0] in begins:
            _clock.begin()
        for now[0] in ends:
            _clock.end()
    now[0] = 10.0
    assert watch.seconds() == 10.0 - (6.0 - 1.0) - (8.5 - 7.0)
    assert said == [NOTICE]
    tell_of_compiling(None)


@compiled
def test_numba_tells_of_the_kernels_that_it_compiles():
    from cascadenorm.mesh import kernel

    names = {"kernel": kernel}
    exec("@kernel\ndef plus(a):\n    return a + 1", names)  # has no file, so that it is kept nowhere
    before = _clock.seconds
    assert names["plus"](1) == 2
    assert _clock.seconds > before and _clock.depth == 0
