"""Work in a background thread, so that the program stays responsive."""

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from cascadenorm.execution.progress import Listener

Result = TypeVar("Result")


class Cancelled(Exception):
    """The job was cancelled."""


class Job(Generic[Result]):
    """A function that runs in its own thread; it must not access data of the host program.

    It is called with a progress listener, which raises Cancelled once the job is cancelled. `fraction` is the share of
    the work that is done, from 0 to 1.
    """

    def __init__(self, work: Callable[[Listener], Result]) -> None:
        self.fraction = 0.0
        self._work, self._cancelled = work, threading.Event()
        self._result: list[Result] = []
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="cascadenorm", daemon=True)
        self._thread.start()

    @property
    def done(self) -> bool:
        """Whether the work has ended, successfully or not."""
        return not self._thread.is_alive()

    @property
    def cancelled(self) -> bool:
        """Whether the job was cancelled."""
        return self._cancelled.is_set()

    def cancel(self) -> None:
        """End the work at its next progress report."""
        self._cancelled.set()

    def result(self) -> Result:
        """Wait for the end; return the result of the function or raise its exception, Cancelled after `cancel`."""
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self._result[0]

    def _run(self) -> None:
        try:
            self._result.append(self._work(self._listen))
        except BaseException as error:
            self._error = error

    def _listen(self, fraction: float) -> None:
        self.fraction = fraction
        if self._cancelled.is_set():
            raise Cancelled
