"""Process many items on the workers of a Dask cluster.

This is the counterpart of `process_map.side_by_side`, which uses local processes.
"""

import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import islice
from threading import Event, Lock
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from threadpoolctl import threadpool_limits

from cascadenorm.compute.threads import limit_threads
from cascadenorm.errors import ParameterError, WorkerError
from cascadenorm.execution.cluster import (
    LOCAL_CLUSTER,
    POLL_INTERVAL_S,
    REPLY_TIMEOUT_S,
    WORKER_TIMEOUT_S,
    dask_client,
    dask_message,
    lost_scheduler,
    mismatch,
    no_workers,
)
from cascadenorm.execution.memory import USABLE_FRACTION, available_memory
from cascadenorm.execution.process_map import Map, use_map
from cascadenorm.version import __version__

if TYPE_CHECKING:
    from distributed import Client, Future

Item = TypeVar("Item")
Result = TypeVar("Result")

PREFETCH = 2
"""Number of items per worker that are started ahead of the current result; results wait in the workers' memory."""


class _Requirements(NamedTuple):
    """Version and folder that a worker must share with this process; the folder matters for relative file names."""

    version: str
    folder: str | None


class _Raised(NamedTuple):
    """An error of the work, as distinct from errors of the cluster."""

    error: Exception


@contextmanager
def on_cluster(scheduler: str, *, workers: int, folder: str | None) -> Iterator[Map]:
    """Connect to a cluster within the context and process items on its workers, even if some of them die.

    The scheduler is an address, or "local" for a cluster on this machine with a number of worker processes. They must
    run in `folder` because file names are relative; None accepts any folder. Dask reassigns the items of a lost worker,
    including those with lost results. Each process works on one item at a time with one thread. Raises what
    `dask_client` raises, ParameterError also if `workers` is above 1 for a cluster given by its address, and
    WorkerError if an item has killed several workers, the scheduler or all workers are lost, or a worker cannot be
    used.
    """
    if scheduler != LOCAL_CLUSTER and workers > 1:
        raise ParameterError(
            f"is {workers}; at {scheduler} all workers of the cluster work", parameter="workers", hint="leave it out"
        )
    memory = int(USABLE_FRACTION * available_memory() / workers)
    with dask_client(scheduler, workers=workers, threads=1, memory=memory) as client:
        yield partial(_map, client, scheduler, _Requirements(__version__, folder))


@contextmanager
def use_cluster(scheduler: str | None, *, workers: int, folder: str | None) -> Iterator[None]:
    """Let `process_map.side_by_side` use a cluster within the context; None keeps local processes."""
    if scheduler is None:
        yield
        return
    with on_cluster(scheduler, workers=workers, folder=folder) as each, use_map(each):
        yield


def _map(
    client: "Client", scheduler: str, here: _Requirements, work: Callable[[Item], Result], items: Iterable[Item], /
) -> Iterator[Result]:
    """Process all items and yield the results in order."""
    left = iter(items)
    begun: deque[Future[Any]] = deque()
    try:
        while True:
            wanted = PREFETCH * max(1, _workers(client, scheduler)) - len(begun)
            for item in islice(left, max(0, wanted)):
                begun.append(client.submit(_process, here, work, item, pure=False))
            if not begun:
                return
            found = _result(client, scheduler, begun[0])
            begun.popleft().release()
            if isinstance(found, _Raised):
                raise found.error
            yield found
    finally:
        for future in begun:
            future.release()


def _process(here: _Requirements, work: Callable[[Item], Result], item: Item) -> Result | _Raised:
    """Process one item in a worker."""
    from distributed import get_worker

    reason = mismatch(__version__, here.version, os.getcwd(), here.folder)
    if reason is not None:
        raise WorkerError(f"the worker {get_worker().address} {reason}")
    with _one_at_a_time, limit_threads(1), threadpool_limits(1):
        try:
            return work(item)
        except Exception as error:
            return _Raised(error)


_one_at_a_time = Lock()
"""Held by the working thread of a worker, because thread limits and memory are shared by the whole process."""


def _result(client: "Client", scheduler: str, future: "Future[Any]") -> Any:
    """Wait for the result of an item as long as there are workers."""
    from distributed import TimeoutError as Late

    in_use, done = time.monotonic(), Event()
    future.add_done_callback(lambda _: done.set())
    while True:
        try:
            if done.wait(POLL_INTERVAL_S):
                return future.result(timeout=REPLY_TIMEOUT_S)
        except Late:  # the worker that held the result is lost, and another one starts again
            pass
        except WorkerError:
            raise
        except Exception as error:  # any error that Dask raises
            raise WorkerError(
                f"the cluster at {scheduler} did not do the work: {dask_message(error)}",
                hint="where workers have ended, memory may be short there",
            ) from None
        now = time.monotonic()
        in_use = now if _workers(client, scheduler) else in_use
        if now > in_use + WORKER_TIMEOUT_S:
            raise no_workers(scheduler, WORKER_TIMEOUT_S)


def _workers(client: "Client", scheduler: str) -> int:
    try:
        return len(client.nthreads())
    except Exception as error:  # connection errors
        raise lost_scheduler(scheduler, error) from None
