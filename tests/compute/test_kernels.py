"""A first run compiles few functions, and a further one none."""

import pytest
from forked import run_alone

FIRST_RUN = """
import numba.core.event as events
compiled = []

class Listener(events.Listener):
    def on_start(self, event):
        function = event.data["dispatcher"].py_func
        compiled.append(function.__module__ + "." + function.__qualname__)

    def on_end(self, event):
        pass

events.register("numba:compile", Listener())
import numpy as np, cascadenorm as cn
x, y = np.mgrid[:9, :9].reshape(2, -1)
vertices = np.stack([x, y, 0.1 * np.random.default_rng(0).normal(size=81)], axis=1)
corner = np.flatnonzero((x < 8) & (y < 8))
faces = np.concatenate([corner[:, None] + (0, 9, 10), corner[:, None] + (0, 10, 1)])
for method in ("bilateral-normal", "auto"):
    cn.denoise(vertices, faces, method=method)
for name in compiled:
    print(name)
"""


@pytest.mark.slow
def test_the_first_run_compiles_few_functions_and_no_text_or_sort_of_numba(tmp_path):
    """Copying a slice brings numba's messages with it, numpy's sort a dozen functions: seconds for each new user."""
    (tmp_path / "program.py").write_text(FIRST_RUN)
    empty = str(tmp_path / "kept")
    compiled = run_alone(tmp_path / "program.py", NUMBA_CACHE_DIR=empty, NUMBA_DISABLE_JIT="0").split()
    assert "cascadenorm.baselines.vertex_update._sweep_range" in compiled
    assert not [name for name in compiled if "unicode" in name or "quicksort" in name]
    assert len(compiled) <= 110


def test_a_further_process_compiles_nothing_and_loads_nothing_that_numba_compiles_from(tmp_path, run_forked):
    """Limits of numbers in a kernel, as numpy names them, bring both back: a quarter of a second in each command."""
    code = FIRST_RUN + "import sys\nprint(*{'numba.np.linalg', 'scipy.linalg'} & set(sys.modules))\n"
    (tmp_path / "program.py").write_text(code)
    run_forked(tmp_path / "program.py", NUMBA_DISABLE_JIT="0")  # compiles what is not yet kept
    assert run_alone(tmp_path / "program.py", NUMBA_DISABLE_JIT="0").split() == []
