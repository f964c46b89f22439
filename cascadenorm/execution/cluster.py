"""Connect to a Dask cluster, or start a temporary one on this machine, and process items on its workers."""

import logging
import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import islice
from os import PathLike
from threading import Event, Lock
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from threadpoolctl import threadpool_limits

from cascadenorm.compute.threads import limit_threads
from cascadenorm.errors import MissingDependencyError, ParameterError, WorkerError
from cascadenorm.execution.memory import USABLE_FRACTION, available_memory
from cascadenorm.execution.process_map import Map, use_map
from cascadenorm.execution.worker_processes import interrupts_blocked
from cascadenorm.version import __version__

if TYPE_CHECKING:
    from distributed import Client, Future

Item = TypeVar("Item")
Result = TypeVar("Result")

LOCAL_CLUSTER = "local"  # name that selects a cluster on this machine instead of the address of a scheduler

POLL_INTERVAL_S = 1.0  # seconds between two checks of the available workers

WORKER_TIMEOUT_S = 300.0  # seconds to wait while a cluster has no usable worker

REPLY_TIMEOUT_S = 30.0  # maximum number of seconds to receive the outcome of finished work, or to restart a worker

START_ATTEMPTS = 3  # of Dask, on a machine that is too busy to begin a thread within 10 s

LOCAL_CLUSTER_CONFIG = {"distributed.deploy.lost-worker-timeout": "365 days"}
"""Settings of Dask for a cluster on this machine.

After this time, Dask checks once whether a lost worker is back and otherwise closes it permanently. The default of 15 s
would also close workers that were lost a second time and are just restarting.
"""

LARGE_TASK_CONFIG = {"distributed.admin.large-graph-warning-threshold": "100 GB"}
"""Settings of Dask for tasks that contain patches of a mesh, which would otherwise cause warnings."""

PREFETCH = 2
"""Number of items per worker that are started ahead of the current result; results wait in the workers' memory."""


@contextmanager
def dask_client(scheduler: str, *, workers: int, threads: int, memory: int) -> Iterator["Client"]:
    """Connect to a scheduler within the context; log messages of Dask are suppressed, and errors describe the problem.

    The scheduler is an address, such as "tcp://10.0.0.1:8786", or "local" for a cluster on this machine, with a number
    of worker processes, and threads and bytes of memory per process. Raises MissingDependencyError if distributed is
    not installed, ParameterError if no scheduler answers at the address, and WorkerError if the machine is too busy to
    start Dask.
    """
    try:
        import dask
        import distributed
    except ModuleNotFoundError as error:
        raise MissingDependencyError("a cluster", package=error.name or "distributed", extra="cluster") from None
    with ExitStack() as stack:
        stack.enter_context(_silent("distributed"))
        stack.enter_context(dask.config.set(LARGE_TASK_CONFIG))
        if scheduler == LOCAL_CLUSTER:
            stack.enter_context(dask.config.set(LOCAL_CLUSTER_CONFIG))
            with interrupts_blocked():  # this process handles Ctrl-C
                cluster = _started(
                    distributed.LocalCluster,
                    n_workers=workers,
                    threads_per_worker=threads,
                    memory_limit=memory,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    worker_dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
                address = stack.enter_context(cluster).scheduler_address
        else:
            address = scheduler
        try:
            client = _started(distributed.Client, address, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:  # TypeError for tls:// without a TLS configuration
            raise ParameterError(
                f"is {scheduler!r}, where no Dask scheduler answers: {error}",
                parameter="scheduler",
                hint='start one by `dask scheduler`, or use "local" for a cluster on this machine',
            ) from None
        yield stack.enter_context(client)


def _started(class_: Callable[..., Result], *args: object, **options: object) -> Result:
    """Return an instance of a class of Dask; where its thread has not begun within Dask's 10 s, try again."""
    for _ in range(START_ATTEMPTS):
        try:
            return class_(*args, **options)
        except AssertionError:  # Dask's only answer to a thread that has not begun
            continue
    raise WorkerError("Dask did not start: the machine is too busy", hint="try again when other programs have ended")


def required_folder(places: Iterable[str | PathLike[str]], values: Iterable[object]) -> str | None:
    """Return the current folder if a place, or an existing file among the values, has a relative name; else None."""
    files = [value for value in values if isinstance(value, str | PathLike) and os.path.exists(value)]
    absolute = all(os.path.isabs(name) for name in [*places, *files])
    return None if absolute else os.getcwd()


def lost_scheduler(scheduler: str, error: Exception, hint: str = "") -> WorkerError:
    return WorkerError(f"the scheduler at {scheduler} does not answer any more: {dask_message(error)}", hint=hint)


def no_workers(scheduler: str, seconds: float) -> WorkerError:
    """Return the error for a cluster that has had no worker for this many seconds."""
    return WorkerError(f"the cluster at {scheduler} has had no worker for {seconds:.0f} seconds")


def mismatch(version: str, wanted_version: str, folder: str, wanted_folder: str | None) -> str | None:
    """Return why a worker with this version and current folder cannot be used; None if it can."""
    if version != wanted_version:
        return f"has cascadenorm {version}, but this process has {wanted_version}"
    if wanted_folder not in (None, folder):
        return f"runs in {folder}, so relative paths refer to other files there: use absolute paths"
    return None


def dask_message(error: Exception) -> str:
    """Return the text of a Dask error, or its class name if the text is empty."""
    return str(error) or type(error).__name__


@contextmanager
def _silent(name: str) -> Iterator[None]:
    """Suppress the log messages of a library within the context."""
    names = [other for other in logging.root.manager.loggerDict if other.split(".")[0] == name]
    levels = {logging.getLogger(other): logging.getLogger(other).level for other in names}
    for logger in levels:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in levels.items():
            logger.setLevel(level)


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
        yield partial(_map, client, scheduler, folder)


@contextmanager
def use_cluster(scheduler: str | None, *, workers: int, folder: str | None) -> Iterator[None]:
    """Let `process_map.parallel_map` use a cluster within the context; None keeps local processes."""
    if scheduler is None:
        yield
        return
    with on_cluster(scheduler, workers=workers, folder=folder) as each, use_map(each):
        yield


def _map(
    client: "Client", scheduler: str, folder: str | None, work: Callable[[Item], Result], items: Iterable[Item], /
) -> Iterator[Result]:
    """Process all items and yield the results in order."""
    left = iter(items)
    begun: deque[Future[Any]] = deque()
    try:
        while True:
            wanted = PREFETCH * max(1, _workers(client, scheduler)) - len(begun)
            for item in islice(left, max(0, wanted)):
                begun.append(client.submit(_process, __version__, folder, work, item, pure=False))
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


def _process(version: str, folder: str | None, work: Callable[[Item], Result], item: Item) -> Result | _Raised:
    """Process one item in a worker, which must have this version and, for relative file names, run in this folder."""
    from distributed import get_worker

    reason = mismatch(__version__, version, os.getcwd(), folder)
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
