"""Multithreaded execution of kernels over index ranges.

A kernel is called as `kernel(start, stop, *arrays)` and writes only the results of start … stop. Its order of
operations for each index does not depend on the range, so results are byte-identical for any number of threads.
"""

import math
import os
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from functools import cache
from threading import Lock
from types import ModuleType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

Result = TypeVar("Result")

BLOCK = 1024  # rows; with about a hundred numbers each they fit into the L2 cache
CHUNKS_PER_THREAD = 4  # balances ranges of unequal cost
SMALLEST_CHUNK = 4096  # indices, on which most kernels spend less than a thread needs to start and stop
SMALLEST_COSTLY_CHUNK = 512  # for kernels that visit many neighbours of each index
SCIPY_BLAS = "scipy.linalg._fblas"  # extension module that is loaded with the BLAS of scipy
SUMS, FEWEST_TERMS = 32, 512  # blocks with partial sums, used if each block has many terms, and many more than sums

_limit: ContextVar[int | None] = ContextVar("thread_limit", default=None)


def thread_count() -> int:
    """Return the number of threads for `parallel_for`: the innermost `limit_threads`, or the available CPUs."""
    limit = _limit.get()
    if limit is not None:
        return limit
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def limit_threads(threads: int | None) -> Iterator[None]:
    """Limit the number of threads inside the block; None keeps the current limit."""
    if threads is not None and threads < 1:
        raise ValueError(f"threads is {threads}; it must be at least 1, or None for all")
    token = _limit.set(_limit.get() if threads is None else threads)
    try:
        yield
    finally:
        _limit.reset(token)


class _BlasLimit:
    """Limit of BLAS to one thread while any thread of this process is inside.

    Some libraries have a process-wide limit that only the thread that set it can lift. A dedicated thread therefore
    sets the limits, and lifts them when the last user leaves.
    """

    def __init__(self) -> None:
        self.renew()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self.renew)

    def renew(self) -> None:
        self._lock, self._inside = Lock(), 0

    def enter(self) -> list[ThreadpoolController]:
        """Limit the libraries that are loaded, and return them."""
        with self._lock:
            if self._inside == 0:
                self._keeper, self._limits, self._limited = ThreadPoolExecutor(1), ExitStack(), 0
            libraries = _blas_libraries()
            if later := libraries[self._limited :]:  # scipy may have loaded its own meanwhile
                self._keeper.submit(_limit_libraries, self._limits, later).result()
            self._inside, self._limited = self._inside + 1, len(libraries)
            return libraries

    def leave(self) -> None:
        with self._lock:
            if self._inside == 1:
                self._keeper.submit(self._limits.close).result()
                self._keeper.shutdown()
            self._inside = max(self._inside - 1, 0)  # a process that was forked inside leaves a block of its parent


_blas_limit = _BlasLimit()


@contextmanager
def one_blas_thread(*_scipy_modules: ModuleType) -> Iterator[None]:
    """Limit BLAS to one thread inside the block, since its order of summation depends on the threads.

    Blocks in different threads may overlap. Pass the scipy modules that the block uses: scipy loads them, and its own
    BLAS, on first use, and a BLAS that is loaded inside the block is not limited.
    """
    libraries = _blas_limit.enter()
    try:
        with ExitStack() as limits:
            _limit_libraries(limits, libraries)  # for those with a limit per thread
            yield
    finally:
        _blas_limit.leave()


def _limit_libraries(limits: ExitStack, libraries: Sequence[ThreadpoolController]) -> None:
    for each in libraries:
        limits.enter_context(each.limit(limits=1))


def _blas_libraries() -> list[ThreadpoolController]:
    """Return the BLAS libraries that are loaded: those of the first call, and those that scipy has loaded since."""
    return [_first_libraries(), _later_libraries()] if SCIPY_BLAS in sys.modules else [_first_libraries()]


@cache
def _first_libraries() -> ThreadpoolController:
    return ThreadpoolController().select(user_api="blas")


@cache
def _later_libraries() -> ThreadpoolController:
    known = [library.filepath for library in _first_libraries().lib_controllers]
    libraries = ThreadpoolController().select(user_api="blas")
    later = [library.filepath for library in libraries.lib_controllers if library.filepath not in known]
    return libraries.select(filepath=later)


class _Pool:
    """Threads for kernels, at most one per CPU, which start on first use; a forked process starts a new pool."""

    def __init__(self) -> None:
        self.renew()
        if hasattr(os, "register_at_fork"):
            os.register_at_fork(after_in_child=self.renew)

    def renew(self) -> None:
        self.executor = ThreadPoolExecutor(os.cpu_count(), "cascadenorm")


_pool = _Pool()


def on_threads(threads: int, count: int, task: Callable[[int], Result]) -> list[Result]:
    """Call task(0) … task(count - 1) on the calling thread and up to threads - 1 others; return the results in order.

    Each thread takes the next number when it has finished the last one. The calling thread works too, so nested calls
    and calls while all threads are busy still finish. After an error, no further number is taken, and the error of the
    failing call with the lowest number is raised.
    """
    if min(threads, count) <= 1:
        return [task(number) for number in range(count)]
    waiting, results, errors = deque(range(count)), dict[int, Result](), dict[int, BaseException]()

    def work() -> None:
        with suppress(IndexError):  # popleft: no numbers are left
            while not errors:
                number = waiting.popleft()
                try:
                    results[number] = task(number)
                except BaseException as error:
                    errors[number] = error

    others = [_pool.executor.submit(work) for _ in range(min(threads, count) - 1)]
    try:
        work()
    finally:  # leave no task running, even after Ctrl-C
        waiting.clear()
        wait([other for other in others if not other.cancel()])
    if errors:
        raise errors[min(errors)]
    return [results[number] for number in range(count)]


def parallel_for(count: int, run: Callable[..., Any], *arguments: Any, smallest: int | None = None) -> list[Any]:
    """Call run(start, stop, *arguments) in parallel on ranges that cover 0 … count.

    The ranges have about the same size. Each has at least `smallest` indices unless there are fewer in all; None
    selects SMALLEST_CHUNK. Returns the results of the calls, in the order of the ranges.
    """
    threads = thread_count()
    most = threads * CHUNKS_PER_THREAD if threads > 1 else 1
    chunks = min(count, max(count // (smallest or SMALLEST_CHUNK), 1), most)
    if chunks == 1:  # avoids the overhead of scheduling
        return [run(0, count, *arguments)]
    return on_threads(threads, chunks, lambda i: run(i * count // chunks, (i + 1) * count // chunks, *arguments))


def in_blocks(count: int, run: Callable[[int, int], NDArray[Any]]) -> NDArray[Any]:
    """Call run(start, stop) in parallel on blocks of 0 … count, and return their rows, (count, …).

    `run` returns stop - start rows; run(0, 0) is called if there are none. The blocks do not depend on the number of
    threads. Use this for operations such as matrix products, whose rounding may depend on the shape. All blocks have
    about the same size, at most BLOCK, since BLAS rounds small matrices differently. Each block runs with one thread.
    """
    first, out = Lock(), list[NDArray[Any]]()
    blocks = max(-(-count // BLOCK), 1)

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
    """Call add(start, stop, sums) in parallel on blocks of 0 … count, and return the total of their sums.

    Each block adds to its own array of the given shape, initially zero. The blocks do not depend on the number of
    threads. A single block is used if the terms are few, or not many more than the sums.
    """
    blocks = SUMS if count >= SUMS * max(FEWEST_TERMS, 4 * math.prod(shape)) else 1
    sums = np.zeros((blocks, *shape))
    starts = [i * count // blocks for i in range(blocks + 1)]
    on_threads(thread_count(), blocks, lambda i: add(starts[i], starts[i + 1], sums[i]))
    return np.asarray(sums.sum(axis=0))
