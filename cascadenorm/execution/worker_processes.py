"""Worker processes that do one job after another.

A process that dies affects only its current job. In `process_map`, by contrast, the end of one process ends the pool.
To let the server of the studio start quickly, this module imports no numerical packages.
"""

import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import Connection, wait
from threading import Thread
from types import FrameType
from typing import Any, Generic, NoReturn, TypeVar

from cascadenorm.errors import WorkerError
from cascadenorm.execution.signals import repeat_if_swallowed

TERMINATION_TIMEOUT_S = 5.0  # seconds that a process has to remove its temporary files


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Block SIGINT within the context, and permanently in processes started within it."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # otherwise the first process would start it, which unblocks SIGINT
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def end_with_parent() -> None:
    """End this process when its parent exits: by SIGTERM and, if that has no effect, immediately."""
    parent = parent_process()
    assert parent is not None

    def watch() -> None:
        parent.join()
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(TERMINATION_TIMEOUT_S)
        os._exit(1)

    Thread(target=watch, daemon=True).start()


Item = TypeVar("Item")
Result = TypeVar("Result")
Sent = TypeVar("Sent")
Received = TypeVar("Received")


class Worker(Generic[Sent, Received]):
    """A process that answers messages.

    It runs `serve`, a picklable function, with its end of the connection until this returns. It ignores Ctrl-C, which
    the parent handles, and ends when the parent exits.
    """

    def __init__(self, serve: Callable[[Connection], object]) -> None:
        context = get_context("spawn")
        self.link, there = context.Pipe()
        self._process = context.Process(target=_run, args=(there, serve), daemon=True)
        with interrupts_blocked():
            self._process.start()
        there.close()

    def send(self, message: Sent) -> None:
        """Send a message to the process; if it has ended meanwhile, `receive` reports that."""
        try:
            self.link.send(message)
        except OSError:
            self.link.close()

    def receive(self) -> Received:
        """Wait for the next answer. Raises WorkerError if the process has ended or the answer cannot be unpickled."""
        try:
            found: Received = self.link.recv()
        except (EOFError, OSError):
            self._process.join(TERMINATION_TIMEOUT_S)
            code = self._process.exitcode
            cause = signal.Signals(-code).name if code is not None and code < 0 else f"exit code {code}"
            hint = "memory may be short"
            if code == 1:  # an error while the process started, when it imports the main script
                hint = "in a script of your own, start the work below `if __name__ == '__main__':`"
            raise WorkerError(f"the process that did the work ended early ({cause})", hint=hint) from None
        except Exception as error:  # the answer cannot be unpickled here
            raise WorkerError(f"what the process returned cannot be read: {type(error).__name__}: {error}") from None
        return found

    def kill(self) -> None:
        self._process.kill()
        self._process.join()

    @staticmethod
    def stop(workers: "Sequence[Worker[Any, Any]]") -> None:
        """Terminate processes; those that do not end within `TERMINATION_TIMEOUT_S` seconds are killed."""
        for worker in workers:
            worker.link.close()
            worker._process.terminate()
        end = time.monotonic() + TERMINATION_TIMEOUT_S
        for worker in workers:
            worker._process.join(max(0.0, end - time.monotonic()))
            worker.kill()


def first_ready(workers: "Sequence[Worker[Sent, Received]]", seconds: float) -> "list[Worker[Sent, Received]]":
    """Wait until a worker has answered or ended, at most this many seconds; return all such workers."""
    closed = [worker for worker in workers if worker.link.closed]
    ready = closed or wait([worker.link for worker in workers], seconds)
    return closed or [worker for worker in workers if worker.link in ready]


def received(link: Connection) -> Iterator[Any]:
    """Yield the messages that arrive until the connection is closed."""
    with suppress(EOFError, OSError):
        while True:
            yield link.recv()


def do_jobs(link: Connection, work: Callable[[Item], Result]) -> None:
    """Process the jobs that arrive, each with its limit of threads for kernels, and send the results."""
    from cascadenorm.compute.threads import limit_threads, one_blas_thread  # loads numerical packages

    with ExitStack() as after_first:
        for number, (job, threads) in enumerate(received(link)):
            with limit_threads(threads):
                result = work(job)
            link.send(result)
            if number == 0:  # all libraries are loaded by now; each limit takes about a millisecond
                after_first.enter_context(one_blas_thread())


def _run(link: Connection, serve: Callable[[Connection], object]) -> None:
    """Run the new process until its function returns or the parent exits."""
    signal.signal(signal.SIGTERM, _terminated)
    repeat_if_swallowed(signal.SIGTERM, SystemExit)
    end_with_parent()
    serve(link)
    _ending()


def _terminated(number: int, _: FrameType | None) -> NoReturn:
    """Exit as after an error, so that temporary files are removed."""
    _ending()
    raise SystemExit(128 + number)


def _ending() -> None:
    """Ignore further SIGTERM signals, which would cause errors in exit handlers."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
