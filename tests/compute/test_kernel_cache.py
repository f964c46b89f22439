"""Compiled kernels are kept on disk and read by the next process, as long as their sources stay the same."""

import pickle
from threading import Barrier, Thread

import numba
import numpy as np
import pytest
from forked import run_alone

from cascadenorm.compute.kernel_cache import KernelFiles
from cascadenorm.mesh import kernel

TWICE = """
import numpy as np
from cascadenorm.compute.kernels import kernel

@kernel
def twice(start, stop, out):
    for i in range(start, stop):
        out[i] *= 2

for dtype in (np.float64, np.float32):
    out = np.arange(4, dtype=dtype)
    twice(1, 3, out)
    print(out.tolist(), sum(twice.stats.cache_hits.values()))
"""


@pytest.fixture
def run_twice(run_forked, tmp_path):
    """Runs the module; what it prints."""

    def run(before: str = "", process=run_forked, kept: str = "kept") -> str:
        module = tmp_path / "module.py"
        if not module.exists():  # older releases of numba take a file that was written again for another
            module.write_text(before + TWICE)
        return process(module, NUMBA_CACHE_DIR=str(tmp_path / kept), NUMBA_DISABLE_JIT="0")

    return run


def test_a_kernel_that_cannot_be_kept_on_disk_runs_all_the_same():
    names = {"kernel": kernel}
    exec("@kernel\ndef twice(start, stop, out):\n    for i in range(start, stop):\n        out[i] *= 2", names)
    out = np.arange(4.0)
    names["twice"](1, 3, out)
    assert out.tolist() == [0, 2, 4, 3]


def test_the_next_process_takes_what_was_compiled_for_each_type(run_twice):
    out = "[0.0, 2.0, 4.0, 3.0] "
    assert run_twice(process=run_alone).split("\n") == [out + "0", out + "0", ""]
    assert run_twice(process=run_alone).split("\n") == [out + "1", out + "2", ""]


def test_a_change_to_a_kernel_that_it_calls_compiles_it_anew(run_twice, tmp_path):
    helper = "from cascadenorm.compute.kernels import kernel\n\n@kernel\ndef amount():\n    return {}\n"
    (tmp_path / "helper.py").write_text(helper.format("2.0"))
    (tmp_path / "module.py").write_text("from helper import amount\n" + TWICE.replace("*= 2", "*= amount()"))
    doubled, tripled = "[0.0, 2.0, 4.0, 3.0] ", "[0.0, 3.0, 6.0, 3.0] "
    assert run_twice().split("\n") == [doubled + "0", doubled + "0", ""]
    assert run_twice().split("\n") == [doubled + "1", doubled + "2", ""]
    (tmp_path / "helper.py").write_text(helper.format("3.00"))  # of another size, so that Python sees the change
    assert run_twice().split("\n") == [tripled + "0", tripled + "0", ""]
    assert run_twice().split("\n") == [tripled + "1", tripled + "2", ""]


def test_a_kernel_that_was_kept_on_disk_is_compiled_into_another(run_twice, tmp_path):
    (tmp_path / "helper.py").write_text(
        "from cascadenorm.compute.kernels import kernel\n\n@kernel\ndef amount(of):\n    return of.sum() + 2.0\n"
    )
    hits = "from helper import amount\n" + TWICE + "print(amount(np.zeros(1)), sum(amount.stats.cache_hits.values()))\n"
    (tmp_path / "module.py").write_text(hits)
    assert run_twice().split("\n")[-2:] == ["2.0 0", ""]
    (tmp_path / "module.py").write_text(hits.replace("*= 2", "*= amount(np.zeros(1))"))
    multiplied = "[0.0, 2.0, 4.0, 3.0] 0"
    assert run_twice().split("\n") == [multiplied, multiplied, "2.0 1", ""]


def test_kernels_are_read_where_nothing_can_be_written(run_twice, tmp_path):
    locked = """
import os, tempfile
if os.path.exists("locked"):
    def refuse(*_, **__):
        raise OSError(30, "Read-only file system")
    tempfile.TemporaryFile = refuse  # by which numba tells whether a folder can be written
"""
    out = "[0.0, 2.0, 4.0, 3.0] "
    assert run_twice(locked).split("\n") == [out + "0", out + "0", ""]
    (tmp_path / "locked").touch()
    assert run_twice(locked).split("\n") == [out + "1", out + "2", ""]


def test_the_folder_of_kernels_may_have_any_name(run_twice):
    out, kept = "[0.0, 2.0, 4.0, 3.0] ", "Jürgen Müller's kernels ☃"
    assert run_twice(kept=kept).split("\n") == [out + "0", out + "0", ""]
    assert run_twice(kept=kept).split("\n") == [out + "1", out + "2", ""]


def test_a_full_disk_keeps_nothing_and_stops_nobody(run_twice, tmp_path):
    full = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))\n"
    assert run_twice(full).startswith("[0.0, 2.0, 4.0, 3.0]")
    assert not [path for path in (tmp_path / "kept").rglob("*") if path.is_file()]


def test_of_two_that_write_at_once_none_reads_what_the_other_wrote(tmp_path):
    for number in range(300):
        both = [KernelFiles(tmp_path, str(number), int) for _ in range(2)]
        start = Barrier(2)

        def save(key, both=both, start=start):
            start.wait()
            both[key].save(key, f"compiled for {key}")

        threads = [Thread(target=save, args=(key,)) for key in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        kept = [both[0].load(key) for key in range(2)]
        assert any(kept)
        assert all(found in (None, f"compiled for {key}") for key, found in enumerate(kept))


@pytest.mark.parametrize("left", [b"", b"not a pickle", pickle.dumps("another")], ids=["empty", "other", "type"])
def test_an_index_that_cannot_be_read_is_written_anew(run_twice, tmp_path, left):
    """As after an update in which a type that a signature refers to has moved to another module."""
    run_twice()
    (index,) = (tmp_path / "kept").rglob("*.nbi")
    version = pickle.dumps(numba.__version__)
    index.write_bytes(version + left)
    out = "[0.0, 2.0, 4.0, 3.0] "
    assert run_twice().split("\n") == [out + "0", out + "0", ""]
    assert run_twice().split("\n") == [out + "1", out + "2", ""]


OTHER_RELEASES = {
    "class renamed": "del caching.IndexDataCacheFile",
    "attribute renamed": "del caching.CacheImpl.filename_base",
    "method renamed": "del caching.IndexDataCacheFile._save_data",
    "other arguments": "caching.FunctionCache.load_overload = lambda self: None",
}


@pytest.mark.parametrize("change", OTHER_RELEASES.values(), ids=OTHER_RELEASES)
def test_with_another_numba_kernels_run_all_the_same(run_twice, change):
    out = "[0.0, 2.0, 4.0, 3.0] 0"
    assert run_twice(f"from numba.core import caching\n{change}\n").split("\n") == [out, out, ""]
