"""Work in a thread, so that a program draws and hears Esc meanwhile."""

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

from cascadenorm.execution.progress import Listener

Result = TypeVar("Result")


class Cancelled(Exception):
    """The work was to end."""


class Job(Generic[Result]):
    """A function in a thread of its own; it must not touch what belongs to the program.

    Parameters
    ----------
    work
        Called with a listener of its progress, which ends it once the job is cancelled.

    Attributes
    ----------
    fraction
        That is done, from 0 to 1.
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
        """Whether the work has ended, well or not."""
        return not self._thread.is_alive()

    @property
    def cancelled(self) -> bool:
        """Whether the work is to end."""
        return self._cancelled.is_set()

    def cancel(self) -> None:
        """Have the work end at the next step of its progress."""
        self._cancelled.set()

    def result(self) -> Result:
        """Wait for the end, and return what the function returned or raise what it raised; Cancelled once cancelled."""
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
