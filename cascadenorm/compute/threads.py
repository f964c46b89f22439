"""Kernels over index ranges, on several threads.

A kernel is `kernel(start, stop, *arrays)` and writes only what belongs to start … stop, in an order that does not
depend on the range; so the bytes of the result do not depend on the number of threads.
"""

import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from threading import Event, Lock, Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from cascadenorm.compute.thread_pool import on_threads

BLOCK = 1024  # rows, of which some hundred numbers each fit into the second cache
CHUNKS_PER_THREAD = 4  # evens out ranges of unequal cost
SMALLEST_CHUNK = 512
SUMS = 32  # blocks that are added up on their own, where each has many more terms than there are sums

_limit: ContextVar[int | None] = ContextVar("thread_limit", default=None)


def thread_count() -> int:
    """Threads that `parallel_for` uses: the innermost `limit_threads`, else the CPUs this process may use."""
    limit = _limit.get()
    if limit is not None:
        return limit
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def limit_threads(threads: int | None) -> Iterator[None]:
    """Use at most `threads` threads inside the block; None leaves the choice as it is."""
    if threads is not None and threads < 1:
        raise ValueError(f"threads is {threads}; it must be at least 1, or None for all")
    token = _limit.set(_limit.get() if threads is None else threads)
    try:
        yield
    finally:
        _limit.reset(token)


class _BlasLimit:
    """One thread for BLAS while any thread of this process is inside.

    Some libraries count threads for the whole process, and only the thread that has limited them can lift the limit
    again; so it is one of our own, which waits until the last one leaves.
    """

    def __init__(self) -> None:
        self._lock, self._inside, self._over = Lock(), 0, Event()

    def enter(self) -> None:
        with self._lock:
            if self._inside == 0:
                limited, self._over = Event(), Event()
                self._keeper = Thread(target=self._keep, args=(limited, self._over), daemon=True)
                self._keeper.start()
                limited.wait()
            self._inside += 1

    def leave(self) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside == 0:
                self._over.set()
                self._keeper.join()

    @staticmethod
    def _keep(limited: Event, over: Event) -> None:
        with _pools().limit(limits=1, user_api="blas"):
            limited.set()
            over.wait()


_blas_limit = _BlasLimit()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let BLAS use one thread inside the block, since it adds in an order by threads; callers may overlap."""
    _blas_limit.enter()
    try:
        with _pools().limit(limits=1, user_api="blas"):  # of libraries that count for each thread
            yield
    finally:
        _blas_limit.leave()


@cache
def _pools() -> ThreadpoolController:
    return ThreadpoolController()


def parallel_for(count: int, run: Callable[..., Any], *arguments: Any, smallest: int = SMALLEST_CHUNK) -> list[Any]:
    """Call run(start, stop, *arguments) on ranges that cover 0 … count, each of at least `smallest` but the last.

    Returns
    -------
    what the calls returned, in the order of the ranges
    """
    threads = thread_count()
    if count and (threads == 1 or count <= smallest):  # without the rest, which takes as long as many a kernel
        return [run(0, count, *arguments)]
    chunk = max(smallest, -(-count // (threads * CHUNKS_PER_THREAD)))
    starts = range(0, count, chunk)
    return on_threads(threads, len(starts), lambda i: run(starts[i], min(starts[i] + chunk, count), *arguments))


def in_blocks(count: int, run: Callable[[int, int], NDArray[Any]]) -> NDArray[Any]:
    """Call run(start, stop) on blocks of 0 … count that do not depend on the threads, each on a thread of its own.

    For what is no kernel, such as products of matrices, whose last bits may depend on their shape. All blocks have
    about the same size, of at most BLOCK, since BLAS rounds otherwise where a matrix is small.

    Parameters
    ----------
    count
        At least 1.

    Returns
    -------
    the rows that the calls returned, stop - start each, in one array
    """
    first, out = Lock(), list[NDArray[Any]]()
    blocks = -(-count // BLOCK)

    def alone(i: int) -> None:
        start, stop = i * count // blocks, (i + 1) * count // blocks
        with limit_threads(1):
            block = run(start, stop)
        with first:
            if not out:
                out.append(np.empty((count, *block.shape[1:]), block.dtype))
        out[0][start:stop] = block

    on_threads(thread_count(), blocks, alone)
    return out[0]


def sums_in_blocks(
    count: int, shape: tuple[int, ...], add: Callable[[int, int, NDArray[np.float64]], Any]
) -> NDArray[np.float64]:
    """Call add(start, stop, sums) on blocks of 0 … count, and add up their sums, which are of one shape and begin at 0.

    The blocks do not depend on the threads. There is one where terms are few, or not many more than the sums.
    """
    blocks = SUMS if count >= SUMS * max(SMALLEST_CHUNK, 4 * math.prod(shape)) else 1
    sums = np.zeros((blocks, *shape))
    starts = [i * count // blocks for i in range(blocks + 1)]
    on_threads(thread_count(), blocks, lambda i: add(starts[i], starts[i + 1], sums[i]))
    return np.asarray(sums.sum(axis=0))
