from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import pytest
from shapes import icosphere, noisy
from threadpoolctl import threadpool_info, threadpool_limits

import cascadenorm as cn
from cascadenorm.interop import save_mesh
from cascadenorm.mesh import one_blas_thread, threads

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


def test_blas_keeps_to_one_thread_until_the_last_of_several_callers_leaves():
    first_left, seen = Barrier(2, timeout=30), []

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
def test_one_thread_means_no_other_is_started(method, monkeypatch, tmp_path):
    save_mesh(tmp_path / "mesh.ply", MESH)

    class OneThread(ThreadPoolExecutor):
        def __init__(self, count):
            assert count == 1
            super().__init__(count)

    monkeypatch.setattr(threads, "ThreadPoolExecutor", OneThread)
    cn.denoise(MESH.vertices, MESH.faces, method=method, threads=1, boundary="smooth")
    cn.denoise_file(tmp_path / "mesh.ply", method=method, threads=1, max_displacement="0.5 edges")
