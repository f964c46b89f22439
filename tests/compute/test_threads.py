"""Kernels and libraries run on as many threads as are asked for, and results come in order."""

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from threading import enumerate as enumerate_threads

import pytest
from shapes import icosphere, noisy
from threadpoolctl import threadpool_info, threadpool_limits

import cascadenorm as cn
from cascadenorm.compute.threads import on_threads
from cascadenorm.io.interop import save_mesh
from cascadenorm.mesh import one_blas_thread

MESH = noisy(icosphere(3), 0.2)


def blas_threads():
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_blas_has_one_thread_inside_and_its_own_number_again_outside():
    with threadpool_limits(2, user_api="blas"):
        with one_blas_thread():
            assert blas_threads() == {1}
            with one_blas_thread():
                assert blas_threads() == {1}
            assert blas_threads() == {1}
        assert blas_threads() == {2}


def test_the_blas_that_scipy_loads_late_has_one_thread_too():
    code = """
import sys
import scipy
from threadpoolctl import threadpool_info
from cascadenorm.mesh import one_blas_thread

def threads():
    return sorted(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")

loaded = ["scipy.linalg._fblas" in sys.modules]
with one_blas_thread():
    first = threads()
    with one_blas_thread(scipy.linalg):
        both = threads()
print(loaded + ["scipy.linalg._fblas" in sys.modules], set(first), set(both), set(threads()), sep="; ")
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "2"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "[False, True]; {1}; {1}; {2}\n"


def test_blas_keeps_to_one_thread_until_the_last_of_several_callers_leaves():
    first_left, seen = Barrier(2), []

    def first():
        with one_blas_thread():
            first_left.wait()  # both are inside
        first_left.wait()

    def second():
        with one_blas_thread():
            first_left.wait()
            first_left.wait()
            seen.append(blas_threads())

    before = blas_threads()
    with ThreadPoolExecutor(2) as pool:
        for task in [pool.submit(first), pool.submit(second)]:
            task.result()
    assert seen == [{1}]
    assert blas_threads() == before


@pytest.mark.parametrize("method", ["auto", "bilateral-normal", "l0"])
def test_one_thread_means_no_other_is_asked(method, monkeypatch, tmp_path):
    save_mesh(tmp_path / "mesh.ply", MESH)
    monkeypatch.setattr("cascadenorm.compute.threads._pool.executor", None)
    cn.denoise(MESH.vertices, MESH.faces, method=method, threads=1, boundary="smooth")
    cn.denoise_file(tmp_path / "mesh.ply", method=method, threads=1, max_displacement="0.5 edges")
    with pytest.raises(AttributeError):
        cn.denoise(MESH.vertices, MESH.faces, method=method, threads=2)


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_every_number_is_claimed_once_and_answers_come_in_order(threads):
    claimed = []

    def square(number):
        claimed.append(number)
        return number * number

    for count in (0, 1, 5, 300):
        claimed.clear()
        assert on_threads(threads, count, square) == [i * i for i in range(count)]
        assert sorted(claimed) == list(range(count))


def test_as_many_threads_work_at_once_as_are_asked_for():
    together = Barrier(2)
    arrivals = on_threads(2, 2, lambda _: together.wait())  # each waits until the other is there
    assert sorted(arrivals) == [0, 1]


def test_threads_are_kept():
    for _ in range(300):
        on_threads(3, 6, lambda _: None)
    assert 1 <= sum(thread.name.startswith("cascadenorm") for thread in enumerate_threads()) <= os.cpu_count()


def test_calls_within_calls_end_though_no_other_thread_is_free(monkeypatch):
    with ThreadPoolExecutor(1) as executor:
        monkeypatch.setattr("cascadenorm.compute.threads._pool.executor", executor)
        found = on_threads(4, 8, lambda i: on_threads(4, 8, lambda j: 10 * i + j))
    assert found == [[10 * i + j for j in range(8)] for i in range(8)]


@pytest.mark.parametrize("error", [ZeroDivisionError, KeyboardInterrupt])
@pytest.mark.parametrize("threads", [1, 3])
def test_an_error_ends_the_call_when_all_that_has_begun_is_over(threads, error):
    begun, ended = [], []

    def fail(number):
        begun.append(number)
        time.sleep(0.01)
        ended.append(number)
        if number >= 2:
            raise error(f"number {number}")

    with pytest.raises(error, match="number 2"):
        on_threads(threads, 1000, fail)
    assert len(begun) <= 2 + threads
    time.sleep(0.05)
    assert sorted(begun) == sorted(ended)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system forks no processes")
def test_a_process_that_was_forked_has_threads_of_its_own():
    code = """
import os, signal, threading
from cascadenorm.compute.threads import on_threads, one_blas_thread
meet = threading.Barrier(2)
on_threads(2, 2, lambda _: meet.wait())
with one_blas_thread():
    child = os.fork()
    if child == 0:
        signal.alarm(600)
        with one_blas_thread():
            meet = threading.Barrier(2)
            on_threads(2, 2, lambda _: meet.wait())
if child == 0:
    with one_blas_thread():
        os._exit(7)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))"""
    started = [sys.executable, "-W", "ignore::DeprecationWarning", "-c", code]
    done = subprocess.run(started, check=True, capture_output=True, text=True)
    assert done.stdout == "7\n"
