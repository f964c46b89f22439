"""Kernels that come with the package are taken where they fit, and compiled where they do not."""

import platform
import shutil

import numba
import pytest
from forked import run_alone
from llvmlite.binding import get_host_cpu_features

from cascadenorm.compute.shipped_kernels import PROCESSORS, shipped_processor

NAME, NEEDED = PROCESSORS.get(platform.machine().lower(), ("", set()))
HERE = NAME and {name for name, present in get_host_cpu_features().items() if present} >= NEEDED
compiled_only = pytest.mark.skipif(numba.config.DISABLE_JIT or not HERE, reason="nothing is compiled, or shipped")

MODULE = """
import sys
from pathlib import Path
import numpy as np
from cascadenorm.compute import shipped_kernels
from cascadenorm.compute.kernels import kernel
shipped_kernels.KERNELS_FOLDER = Path("shipped")
{before}

@kernel
def scaled(start, stop, out):
    for i in range(start, stop):
        out[i] *= {factor}

for dtype in (np.float64, np.float32):
    out = np.arange(4, dtype=dtype)
    scaled(1, 3, out)
    print(out.tolist(), sum(scaled.stats.cache_hits.values()))
if "ship" in sys.argv:
    scaled._cache.ship()
"""
COMPILED, TAKEN = (["[0.0, 2.0, 4.0, 3.0] 0"] * 2, ["[0.0, 2.0, 4.0, 3.0] 1", "[0.0, 2.0, 4.0, 3.0] 2"])


SHIPPED = {"NUMBA_CPU_NAME": NAME, "NUMBA_CPU_FEATURES": ""}
"""Variables of a process that compiles kernels as they are shipped."""


def run(process, folder, kept, *words, factor=2, before="", **variables):
    """Run the module in a process with the kernels that were kept in a folder; what it prints."""
    (folder / "module.py").write_text(MODULE.format(factor=factor, before=before))
    variables |= {"NUMBA_CACHE_DIR": str(folder / kept), "NUMBA_DISABLE_JIT": "0"}
    return process(folder / "module.py", *words, **variables).splitlines()


@pytest.fixture(scope="module")
def made(tmp_path_factory, run_forked):
    """A folder with the module, and its kernel for both types as it is shipped."""
    folder = tmp_path_factory.mktemp("made")
    run(run_forked, folder, "own")  # compiled for this very processor: not shipped
    assert run(run_alone, folder, "own", "ship", **SHIPPED) == COMPILED
    assert len(list((folder / "shipped").iterdir())) == 2
    return folder


@pytest.fixture
def shipped(made, tmp_path):
    """A copy of that folder, which a test may change."""
    return shutil.copytree(made, tmp_path, dirs_exist_ok=True)


@compiled_only
def test_a_first_run_takes_what_was_shipped_and_keeps_nothing(shipped):
    assert run(run_alone, shipped, "empty") == TAKEN
    assert not [path for path in (shipped / "empty").rglob("*") if path.is_file()]


@compiled_only
@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("factor", 3),
        ("before", "numba = shipped_kernels.numba\nnumba.__version__ += '.post1'"),
        ("before", "shipped_kernels.llvmlite.__version__ += '.post1'"),
        ("before", "sys.implementation.cache_tag += '-other'"),
        ("NUMBA_CPU_NAME", "generic"),
    ],
    ids=["source", "numba", "llvmlite", "python", "processor"],
)
def test_another_one_compiles(run_forked, shipped, setting, value):
    if NAME == "generic" and setting == "NUMBA_CPU_NAME":
        pytest.skip("that is what kernels are shipped for here")
    other = setting == "NUMBA_CPU_NAME"  # which a process reads before it compiles anything
    process, features = (run_alone, {"NUMBA_CPU_FEATURES": ""}) if other else (run_forked, {})
    lines = run(process, shipped, "empty", **{setting: value}, **features)
    assert [line.split()[-1] for line in lines] == ["0", "0"]
    assert lines[0].startswith("[0.0, 3.0, 6.0, 3.0]" if setting == "factor" else "[0.0, 2.0, 4.0, 3.0]")


@compiled_only
def test_another_source_of_a_kernel_that_it_calls_compiles(run_forked, tmp_path):
    helper = "from cascadenorm.compute.kernels import kernel\n\n@kernel\ndef amount():\n    return {}\n"
    calling = {"factor": "amount()", "before": "from helper import amount"}
    (tmp_path / "helper.py").write_text(helper.format("2.0"))
    assert run(run_alone, tmp_path, "own", "ship", **calling, **SHIPPED) == COMPILED
    assert run(run_forked, tmp_path, "empty", **calling) == TAKEN
    (tmp_path / "helper.py").write_text(helper.format("3.00"))  # of another size, so that Python sees the change
    assert run(run_forked, tmp_path, "other", **calling) == ["[0.0, 3.0, 6.0, 3.0] 0"] * 2


@compiled_only
def test_where_a_file_is_damaged_the_kernel_is_compiled(run_forked, shipped):
    for path in (shipped / "shipped").iterdir():
        path.write_bytes(path.read_bytes()[:100])
    assert run(run_forked, shipped, "empty") == COMPILED


@pytest.mark.parametrize(
    ("triple", "processor", "features", "expected"),
    [
        ("x86_64-unknown-linux-gnu", "znver4", "+avx2,+bmi,+bmi2,+f16c,+fma,+lzcnt,+movbe,-avx512f", "x86-64-v3"),
        ("x86_64-unknown-linux-gnu", "sandybridge", "+avx,-avx2,-bmi,-bmi2,-f16c,-fma,-lzcnt,-movbe", None),
        ("x86_64-pc-windows-msvc", "x86-64-v3", "", "x86-64-v3"),
        ("x86_64-pc-windows-msvc", "generic", "", None),
        ("arm64-apple-darwin24.1.0", "apple-m3", "+neon", "generic"),
        ("aarch64-unknown-linux-gnu", "neoverse-n1", "", "generic"),
        ("powerpc64le-unknown-linux-gnu", "pwr10", "", None),
    ],
)
def test_code_is_shipped_for_processors_that_run_it(triple, processor, features, expected):
    assert shipped_processor(triple, processor, features) == expected
