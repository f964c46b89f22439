"""Compiled kernels over index ranges, on several threads.

A kernel is `kernel(start, stop, *arrays)` and writes only what belongs to start … stop, in an order that does not
depend on the range; so the bytes of the result do not depend on the number of threads.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

BLOCK = 8192
CHUNKS_PER_THREAD = 4  # evens out ranges of unequal cost
SMALLEST_CHUNK = 512

kernel = numba.njit(nogil=True, cache=True, error_model="numpy")
"""Decorator of every compiled loop: releases the interpreter, is cached on disk, divides by zero as numpy does."""

_limit: ContextVar[int | None] = ContextVar("thread_limit", default=None)


def thread_count() -> int:
    """Threads that `over` uses: the innermost `limit_threads`, else the CPUs this process may use."""
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


def over(count: int, run: Callable[..., Any], *arguments: Any, smallest: int = SMALLEST_CHUNK) -> list[Any]:
    """Call run(start, stop, *arguments) on ranges that cover 0 … count, each of at least `smallest` but the last.

    Returns
    -------
    what the calls returned, in the order of the ranges
    """
    threads = thread_count()
    chunk = max(smallest, -(-count // (threads * CHUNKS_PER_THREAD)))
    starts = range(0, count, chunk)
    if threads == 1 or len(starts) < 2:
        return [run(start, min(start + chunk, count), *arguments) for start in starts]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda start: run(start, min(start + chunk, count), *arguments), starts))


def in_blocks(count: int, run: Callable[[int, int], NDArray[Any]]) -> NDArray[Any]:
    """Call run(start, stop) on blocks of 0 … count that do not depend on the threads, each on a thread of its own.

    For what is no kernel, such as products of matrices, whose last bits may depend on their shape.

    Returns
    -------
    the rows that the calls returned, stop - start each, in one array
    """

    def alone(start: int) -> NDArray[Any]:
        with limit_threads(1):
            return run(start, min(start + BLOCK, count))

    starts = range(0, count, BLOCK)
    with ThreadPoolExecutor(thread_count()) as pool:
        for start, block in zip(starts, pool.map(alone, starts), strict=True):
            if start == 0:
                out = np.empty((count, *block.shape[1:]), block.dtype)
            out[start : start + BLOCK] = block
    return out
