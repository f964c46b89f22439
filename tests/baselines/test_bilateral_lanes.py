"""Vector instructions where numba and llvmlite allow them, plain loops where not, the same bytes either way."""

from hashlib import sha256
from pathlib import Path

import numba
import pytest
from forked import run_alone
from shapes import icosphere, noisy

from cascadenorm import denoise
from cascadenorm.baselines import bilateral_lanes, iterated_bilateral
from cascadenorm.baselines.bilateral_lanes import equals
from cascadenorm.baselines.iterated_bilateral import _filter_face, iterated_bilateral_normals

compiled_only = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
BALL = noisy(icosphere(2), 0.3)
HELPERS = str(Path(__file__).parents[1] / "helpers")
OTHER_RELEASES = {
    "modules moved": """
import builtins
found = builtins.__import__
def search(name, globals=None, *rest):
    asking = (globals or {}).get("__name__", "")
    if asking in ("cascadenorm.compute.kernel_cache", "cascadenorm.baselines.bilateral_lanes"):
        if name.startswith(("numba.core", "llvmlite")):
            raise ImportError(name)
    return found(name, globals, *rest)
builtins.__import__ = search
""",
    "class renamed": "import numba, llvmlite.ir\ndel llvmlite.ir.VectorType\n",
}
FILTERED = """
import sys
sys.path.insert(0, sys.argv[1])
from hashlib import sha256
import numba
from shapes import icosphere, noisy
from cascadenorm.baselines import iterated_bilateral as filters
print(filters._compiled(*range(7)) is filters._filter_face)
uncached = numba.njit(nogil=True, error_model="numpy")
filters._bilateral_range = uncached(filters._bilateral_range.py_func)
(normals,) = filters.iterated_bilateral_normals(noisy(icosphere(2), 0.3), sigma_r=(0.1, 0.2, 0.5, 1.0), passes=(9,))
print(sha256(normals.tobytes()).hexdigest())
"""
DENOISED = """
import sys
sys.path.insert(0, sys.argv[1])
from hashlib import sha256
from shapes import icosphere, noisy
from cascadenorm import denoise
print(sha256(denoise(noisy(icosphere(2), 0.3)).vertices.tobytes()).hexdigest())
"""


@compiled_only
def test_with_another_llvmlite_plain_loops_filter_to_the_same_bytes(tmp_path, run_forked):
    assert iterated_bilateral._compiled(*range(7)) is not _filter_face
    (normals,) = iterated_bilateral_normals(BALL, sigma_r=(0.1, 0.2, 0.5, 1.0), passes=(9,))
    (tmp_path / "program.py").write_text(OTHER_RELEASES["class renamed"] + FILTERED)
    printed = run_forked(tmp_path / "program.py", HELPERS).splitlines()  # with a warning
    assert {"True", digest(normals)} <= set(printed)


@compiled_only
@pytest.mark.slow  # compiles every kernel that the default needs
@pytest.mark.parametrize("change", OTHER_RELEASES.values(), ids=OTHER_RELEASES)
def test_the_default_method_gives_the_same_bytes_with_another_numba(change, tmp_path):
    (tmp_path / "program.py").write_text(change + DENOISED)
    printed = run_alone(tmp_path / "program.py", HELPERS, NUMBA_CACHE_DIR=str(tmp_path / "kept"))
    assert printed.split() == [digest(denoise(BALL).vertices)]


def digest(array) -> str:
    return sha256(array.tobytes()).hexdigest()


@compiled_only
def test_vectors_are_taken_only_if_they_equal_the_plain_loops():
    def other(*arguments):
        _filter_face(*arguments)
        arguments[-1][0, 0] += 1

    assert equals(_filter_face)
    assert not equals(other)


@pytest.mark.parametrize("fault", [lambda plain: False, None], ids=["other bytes", "not callable"])
def test_a_fallback_to_plain_loops_warns(monkeypatch, fault):
    monkeypatch.setattr(bilateral_lanes, "equals", fault)
    with pytest.warns(RuntimeWarning, match="learned methods take longer"):
        assert iterated_bilateral._compiled(*range(7)) is _filter_face
