"""Work in a background thread, so that the program stays responsive."""

import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import Generic, TypeVar

from cascadenorm.execution.progress import Cancelled, Listener

Result = TypeVar("Result")


class BackgroundJob(Generic[Result]):
    """A function that runs in its own thread; it must not access data of the host program.

    It is called with a progress listener, which raises Cancelled once the job is cancelled. `fraction` is the share of
    the work that is done, from 0 to 1.
    """

    def __init__(self, work: Callable[[Listener], Result]) -> None:
        self.fraction, self.cancelled = 0.0, False
        self._future: Future[Result] = Future()
        threading.Thread(target=self._run, args=[work], name="cascadenorm", daemon=True).start()

    @property
    def done(self) -> bool:
        """Whether the work has ended, successfully or not."""
        return self._future.done()

    def cancel(self) -> None:
        """End the work at its next progress report."""
        self.cancelled = True

    def result(self) -> Result:
        """Wait for the end; return the result of the function or raise its exception, Cancelled after `cancel`."""
        return self._future.result()

    def _run(self, work: Callable[[Listener], Result]) -> None:
        try:
            self._future.set_result(work(self._listen))
        except BaseException as error:
            self._future.set_exception(error)

    def _listen(self, fraction: float) -> None:
        self.fraction = fraction
        if self.cancelled:
            raise Cancelled
