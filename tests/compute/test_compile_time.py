"""A first run says that it compiles, and reports the time of the method alone."""

import json

import numba
import pytest
from shapes import icosphere, noisy

from cascadenorm.compute.compile_time import NOTICE, Stopwatch, _clock, tell_of_compiling
from cascadenorm.io.interop import save_mesh

compiled = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")


FIRST_RUN = """
from cascadenorm.cli import main
from cascadenorm.compute.compile_time import _clock
try:
    main()
except SystemExit as end:
    print(_clock.seconds, end.code)
"""


@compiled
def test_the_first_run_says_that_it_compiles_and_does_not_count_it(tmp_path, run_forked):
    save_mesh(tmp_path / "ball.ply", noisy(icosphere(2), 0.2))
    (tmp_path / "program.py").write_text(FIRST_RUN)
    variables = {"NUMBA_CACHE_DIR": str(tmp_path / "kept"), "NUMBA_DISABLE_JIT": "0"}
    words = ("denoise", "ball.ply", "--method", "laplacian", "--force", "--json")
    found = []
    for _ in range(2):
        said, brace, printed = run_forked(tmp_path / "program.py", *words, **variables).partition("{")
        *report, last = printed.splitlines()
        seconds, code = last.split()
        assert code == "0"
        found.append((said, float(seconds), json.loads(brace + "\n".join(report))["seconds"]))
    (first, compiling, method), (second, none, _) = found
    assert first == f"cascadenorm: {NOTICE}\n" and second == ""
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
