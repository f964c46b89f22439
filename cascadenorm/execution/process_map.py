"""Work in several processes, each on one thread.

By concurrent.futures: joblib's processes print traces at Ctrl-C and outlive a parent that is killed.
"""

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
from cascadenorm.execution.child_processes import end_with_parent, interrupts_blocked

Item = TypeVar("Item")
Result = TypeVar("Result")


class Map(Protocol):
    """Like `map` with one iterable."""

    def __call__(self, work: Callable[[Item], Result], items: Iterable[Item], /) -> Iterator[Result]:
        """Do the work of each item; the results come in order."""


@contextmanager
def side_by_side(count: int) -> Iterator[Map]:
    """Keep a pool of processes for the block; for a count of 1 none is started, and threads are not limited.

    For work in Python between short kernels, in which threads would wait for one another. Within `done_by` another map
    does it.

    Raises
    ------
    WorkerError
        One of the processes ended before its work was done.
    """
    if (other := _other.get()) is not None:
        yield other
        return
    if count == 1:
        yield map
        return
    with ProcessPoolExecutor(count, get_context("spawn"), initializer=end_with_parent) as pool:
        try:
            yield partial(_submitted, pool)
        except BrokenProcessPool:
            raise WorkerError(
                "a worker process ended before its work was done",
                hint="where memory is short, use fewer threads; in a script of your own, start the work below "
                "`if __name__ == '__main__':`",
            ) from None
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def done_by(other: Map) -> Iterator[None]:
    """Have the work of `side_by_side` done by another map for the block, such as that of a cluster."""
    token = _other.set(other)
    try:
        yield
    finally:
        _other.reset(token)


_other: ContextVar[Map | None] = ContextVar("_other", default=None)


def _submitted(pool: ProcessPoolExecutor, work: Callable[[Item], Result], items: Iterable[Item], /) -> Iterator[Result]:
    """Submit work to the pool, whose processes start here; they ignore Ctrl-C, and the parent stops them."""
    with interrupts_blocked():
        return pool.map(partial(_on_one_thread, work), items)


def _on_one_thread(work: Callable[[Item], Result], item: Item) -> Result:
    with limit_threads(1), threadpool_limits(1):  # of all libraries that the work needs: they are loaded by now
        return work(item)
