"""Connect to a Dask cluster, or start a temporary one on this machine."""

import logging
import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from os import PathLike
from typing import TYPE_CHECKING

from cascadenorm.errors import MissingDependencyError, ParameterError, WorkerError
from cascadenorm.execution.child_processes import interrupts_blocked

if TYPE_CHECKING:
    from distributed import Client

LOCAL_CLUSTER = "local"
"""Name that selects a cluster on this machine instead of the address of a scheduler."""

POLL_INTERVAL_S = 1.0
"""Seconds between two checks of the available workers."""

WORKER_TIMEOUT_S = 300.0
"""Seconds to wait while a cluster has no usable worker."""

REPLY_TIMEOUT_S = 30.0
"""Maximum number of seconds to receive the outcome of finished work, or to restart a worker."""

LOCAL_CLUSTER_CONFIG = {"distributed.deploy.lost-worker-timeout": "365 days"}
"""Settings of Dask for a cluster on this machine.

After this time, Dask checks once whether a lost worker is back and otherwise closes it permanently. The default of 15 s
would also close workers that were lost a second time and are just restarting.
"""


LARGE_TASK_CONFIG = {"distributed.admin.large-graph-warning-threshold": "100 GB"}
"""Settings of Dask for tasks that contain patches of a mesh, which would otherwise cause warnings."""


@contextmanager
def dask_client(scheduler: str, *, workers: int, threads: int, memory: int) -> Iterator["Client"]:
    """Connect to a scheduler within the context; log messages of Dask are suppressed, and errors describe the problem.

    The scheduler is an address, such as "tcp://10.0.0.1:8786", or "local" for a cluster on this machine, with a number
    of worker processes, and threads and bytes of memory per process. Raises MissingDependencyError if distributed is
    not installed, and ParameterError if no scheduler answers at the address.
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
                address = stack.enter_context(
                    distributed.LocalCluster(
                        n_workers=workers,
                        threads_per_worker=threads,
                        memory_limit=memory,
                        host="127.0.0.1",
                        dashboard_address="127.0.0.1:0",
                        worker_dashboard_address="127.0.0.1:0",
                        silence_logs=logging.CRITICAL,
                    )
                ).scheduler_address
        else:
            address = scheduler
        try:
            client = distributed.Client(address, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ParameterError(
                f"is {scheduler!r}, where no Dask scheduler answers: {error}",
                parameter="scheduler",
                hint='start one by `dask scheduler`, or use "local" for a cluster on this machine',
            ) from None
        yield stack.enter_context(client)


def required_folder(places: Iterable[str | PathLike[str]], values: Iterable[object]) -> str | None:
    """Return the current folder if workers must run in it, or None if all file names are absolute.

    The places are files, folders or patterns; among the values, those that name existing files count.
    """
    files = [value for value in values if isinstance(value, str | PathLike) and os.path.exists(value)]
    absolute = all(os.path.isabs(name) for name in [*places, *files])
    return None if absolute else os.getcwd()


def lost_scheduler(scheduler: str, error: Exception, hint: str = "") -> WorkerError:
    """Return the error for a lost connection."""
    return WorkerError(f"the scheduler at {scheduler} does not answer any more: {dask_message(error)}", hint=hint)


def no_workers(scheduler: str, seconds: float) -> WorkerError:
    """Return the error for a cluster that has had no worker for this many seconds."""
    return WorkerError(f"the cluster at {scheduler} has had no worker for {seconds:.0f} seconds")


def mismatch(version: str, wanted_version: str, folder: str, wanted_folder: str | None) -> str | None:
    """Return why a worker with this version and current folder cannot be used; None if it can."""
    if version != wanted_version:
        return f"has cascadenorm {version}, and here is {wanted_version}"
    if wanted_folder not in (None, folder):
        return f"runs in {folder}, where relative names mean others: give absolute ones"
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
