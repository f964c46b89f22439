"""Process items in several processes of concurrent.futures; those of joblib outlive a killed parent."""

import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from multiprocessing import get_context
from typing import Protocol, TypeVar

from threadpoolctl import threadpool_limits

from cascadenorm.compute.threads import limit_threads
from cascadenorm.errors import WorkerError
from cascadenorm.execution.signals import interrupted_once
from cascadenorm.execution.worker_processes import end_with_parent, interrupts_blocked

MOST_PROCESSES = 61 if sys.platform == "win32" else 1000  # Windows cannot wait for more

Item = TypeVar("Item")
Result = TypeVar("Result")


class Map(Protocol):
    """A function like `map` with one iterable."""

    def __call__(self, work: Callable[[Item], Result], items: Iterable[Item], /) -> Iterator[Result]:
        """Process all items and yield the results in order."""


@contextmanager
def parallel_map(count: int) -> Iterator[Map]:
    """Provide a `map` that uses a pool of processes; a count of 1 starts no process and does not limit threads.

    Processes suit Python code between short kernels, where threads would wait for each other. Within `use_map`, another
    map is used instead. Raises WorkerError if a process ended before its work was done.
    """
    if (other := _other.get()) is not None:
        yield other
        return
    if count == 1:
        yield map
        return
    with (
        interrupted_once(),  # a second Ctrl-C while the pool stops could leave its processes waiting for work
        ProcessPoolExecutor(min(count, MOST_PROCESSES), get_context("spawn"), initializer=end_with_parent) as pool,
    ):
        try:
            yield partial(_submit, pool)
        except BrokenProcessPool:
            raise WorkerError(
                "a worker process ended before its work was done",
                hint="where memory is short, use fewer threads; in a script of your own, start the work below "
                "`if __name__ == '__main__':`",
            ) from None
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def use_map(other: Map) -> Iterator[None]:
    """Let `parallel_map` use another map within the context, such as that of a cluster."""
    token = _other.set(other)
    try:
        yield
    finally:
        _other.reset(token)


_other: ContextVar[Map | None] = ContextVar("_other", default=None)


def _submit(pool: ProcessPoolExecutor, work: Callable[[Item], Result], items: Iterable[Item], /) -> Iterator[Result]:
    """Submit work to the pool, whose processes start here; they ignore Ctrl-C, and the parent stops them."""
    with interrupts_blocked():
        return pool.map(partial(_on_one_thread, work), items)


def _on_one_thread(work: Callable[[Item], Result], item: Item) -> Result:
    with limit_threads(1), threadpool_limits(1):  # covers all libraries, which are loaded by now
        return work(item)
