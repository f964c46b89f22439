"""The connection to a Dask cluster, or a cluster of its own on this machine for as long as the work takes."""

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
"""The name of a cluster on this machine, in place of the address of a scheduler."""

POLL = 1.0
"""Seconds between two looks at which workers are there."""

WORKER_TIMEOUT_S = 300.0
"""Seconds to wait while a cluster has no worker that can be used."""

ANSWER = 30.0
"""Seconds that the outcome of finished work may take to arrive, and a worker to be restarted."""

OWN_CLUSTER = {"distributed.deploy.lost-worker-timeout": "365 days"}
"""Settings of Dask for a cluster on this machine.

So long after a worker was lost, Dask looks once whether it is there, and closes it for good if not. At the 15 s that
Dask has by itself, this hits workers that were lost a second time and are just being restarted.
"""


LARGE_TASKS = {"distributed.admin.large-graph-warning-threshold": "100 GB"}
"""Settings of Dask for tasks that carry patches of a mesh, of which it warns otherwise."""


@contextmanager
def connected(scheduler: str, *, workers: int, threads: int, memory: int) -> Iterator["Client"]:
    """Connect to a scheduler for the block; the messages of the library are left out, errors say what happens.

    Parameters
    ----------
    scheduler
        Its address, such as "tcp://10.0.0.1:8786", or "local" for a cluster on this machine.
    workers, threads, memory
        Of the cluster on this machine: processes, threads of each, bytes of each.

    Raises
    ------
    MissingDependencyError
        Distributed is not installed.
    ParameterError
        No scheduler answers at the address.
    """
    try:
        import dask
        import distributed
    except ModuleNotFoundError as error:
        raise MissingDependencyError("a cluster", package=error.name or "distributed", extra="cluster") from None
    with ExitStack() as stack:
        stack.enter_context(_silent("distributed"))
        stack.enter_context(dask.config.set(LARGE_TASKS))
        if scheduler == LOCAL_CLUSTER:
            stack.enter_context(dask.config.set(OWN_CLUSTER))
            with interrupts_blocked():  # Ctrl-C is for this process to answer
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


def folder_of_names(places: Iterable[str | PathLike[str]], values: Iterable[object]) -> str | None:
    """Return the folder in which workers must run, this one; None where names of files mean the same in any folder.

    Parameters
    ----------
    places
        Files, folders, patterns.
    values
        Anything; those that are files count.
    """
    files = [value for value in values if isinstance(value, str | PathLike) and os.path.exists(value)]
    absolute = all(os.path.isabs(name) for name in [*places, *files])
    return None if absolute else os.getcwd()


def without_scheduler(scheduler: str, error: Exception, hint: str = "") -> WorkerError:
    """Return the error of a connection that is lost."""
    return WorkerError(f"the scheduler at {scheduler} does not answer any more: {dask_message(error)}", hint=hint)


def without_workers(scheduler: str, seconds: float) -> WorkerError:
    """Return the error of a cluster that has had no worker for so long."""
    return WorkerError(f"the cluster at {scheduler} has had no worker for {seconds:.0f} seconds")


def dask_message(error: Exception) -> str:
    """Return the text of an error of Dask's, or its name where it has none."""
    return str(error) or type(error).__name__


@contextmanager
def _silent(name: str) -> Iterator[None]:
    """Leave out the messages of a library for the block."""
    names = [other for other in logging.root.manager.loggerDict if other.split(".")[0] == name]
    levels = {logging.getLogger(other): logging.getLogger(other).level for other in names}
    for logger in levels:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in levels.items():
            logger.setLevel(level)
