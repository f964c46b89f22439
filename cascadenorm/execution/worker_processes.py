"""Processes that do one job at a time; one that ends early takes its own job along and no other.

`process_map` is for work that fails as a whole: there the end of a process ends the pool.
"""

import os
import signal
import time
from collections.abc import Callable, Sequence
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from threading import Thread
from types import FrameType
from typing import Any, Generic, NoReturn, TypeVar

from threadpoolctl import threadpool_limits

from cascadenorm.compute.threads import limit_threads
from cascadenorm.errors import WorkerError
from cascadenorm.execution.child_processes import interrupts_blocked

Item = TypeVar("Item")
Result = TypeVar("Result")

GRACE = 5.0
"""Seconds that a process has to remove its temporary files."""


class Worker(Generic[Item, Result]):
    """A process that does jobs, one after the other.

    Parameters
    ----------
    work
        What is done with a job in the process; both are pickled.

    It ignores Ctrl-C, which is for the parent to answer, and ends when the parent is gone.
    """

    def __init__(self, work: Callable[[Item], Result]) -> None:
        self.link, there = get_context("spawn").Pipe()
        self._process = get_context("spawn").Process(target=_serve, args=(there, work), daemon=True)
        with interrupts_blocked():
            self._process.start()
        there.close()

    def begin(self, job: Item, threads: int) -> None:
        """Begin a job, in which kernels and libraries use that many threads; the process may have ended meanwhile."""
        try:
            self.link.send((job, threads))
        except OSError:  # `result` says so
            self.link.close()

    def result(self) -> Result:
        """Wait for the result of the job.

        Raises
        ------
        WorkerError
            The process has ended before, or its result cannot be read.
        """
        try:
            found: Result = self.link.recv()
        except (EOFError, OSError):
            self._process.join(GRACE)
            code = self._process.exitcode
            cause = signal.Signals(-code).name if code is not None and code < 0 else f"exit code {code}"
            raise WorkerError(f"the process that did the work ended early ({cause}): memory may be short") from None
        except Exception as error:  # of whatever class cannot be made again here
            raise WorkerError(f"what the process returned cannot be read: {type(error).__name__}: {error}") from None
        return found

    @staticmethod
    def stop(workers: "Sequence[Worker[Any, Any]]") -> None:
        """End processes; those that do not within `GRACE` seconds are killed."""
        for worker in workers:
            worker.link.close()
            worker._process.terminate()
        end = time.monotonic() + GRACE
        for worker in workers:
            worker._process.join(max(0.0, end - time.monotonic()))
            worker._process.kill()
            worker._process.join()


def first_ready(workers: "Sequence[Worker[Item, Result]]", seconds: float | None) -> "list[Worker[Item, Result]]":
    """Wait until one of the workers has a result or has ended, or for so many seconds; return those that have."""
    closed = [worker for worker in workers if worker.link.closed]
    ready = closed or wait([worker.link for worker in workers], seconds)
    return closed or [worker for worker in workers if worker.link in ready]


def _serve(link: Connection, work: Callable[[Item], Result]) -> None:
    """Do the jobs that arrive until the parent ends."""
    signal.signal(signal.SIGTERM, _terminated)
    Thread(target=_end_with_parent, daemon=True).start()
    while True:
        try:
            job, threads = link.recv()
        except (EOFError, OSError):
            return _ending()
        with limit_threads(threads), threadpool_limits(threads):
            result = work(job)
        link.send(result)


def _terminated(number: int, _: FrameType | None) -> NoReturn:
    """End as on an error, so that temporary files are removed."""
    _ending()
    raise SystemExit(128 + number)


def _ending() -> None:
    """Ignore what ends this process from now on: within the handlers of its exit it would be an error."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)


def _end_with_parent() -> None:
    """End this process when its parent is gone, as on SIGTERM and, where that does not help, at once."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(GRACE)
    os._exit(1)
