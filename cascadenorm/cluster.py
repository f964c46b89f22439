"""The connection to a Dask cluster, or a cluster of its own on this machine for as long as the work takes."""

import logging
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING

from cascadenorm.child_processes import interrupts_blocked
from cascadenorm.errors import MissingDependencyError, ParameterError

if TYPE_CHECKING:
    from distributed import Client

LOCAL = "local"
"""The name of a cluster on this machine, in place of the address of a scheduler."""


@contextmanager
def connected(scheduler: str, *, workers: int, threads: int, memory: int) -> Iterator["Client"]:
    """Connect to a scheduler for the block; the messages of the library are left out, errors say what happens.

    Parameters
    ----------
    scheduler : its address, such as "tcp://10.0.0.1:8786", or "local" for a cluster on this machine
    workers, threads, memory : of the cluster on this machine: processes, threads of each, bytes of each

    Raises
    ------
    MissingDependencyError : distributed is not installed
    ParameterError : no scheduler answers at the address
    """
    try:
        import distributed
    except ModuleNotFoundError as error:
        raise MissingDependencyError("a cluster", package=error.name or "distributed", extra="cluster") from None
    with ExitStack() as stack:
        stack.enter_context(_silent("distributed"))
        if scheduler == LOCAL:
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
