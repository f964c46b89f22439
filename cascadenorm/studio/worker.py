"""The studio's worker process: a crash or a lack of memory in it does not end the server.

The process is reused, since starting one and opening a mesh take seconds. A request is cancelled when it next reports
its progress; if it does not do so in time, the process is killed and another one started.
"""

from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from queue import SimpleQueue
from threading import Thread
from time import monotonic
from typing import Any, NamedTuple

from cascadenorm.errors import CascadenormError, OutputError, ParameterError
from cascadenorm.execution.child_processes import end_with_parent, interrupts_blocked
from cascadenorm.studio.names import spelled

INTERVAL = 0.1
"""Seconds between two reports of progress."""


class Request(NamedTuple):
    """A request to the worker, of one of the kinds in `requests`."""

    number: int
    kind: str
    arguments: dict[str, Any]


class Reply(NamedTuple):
    """A reply of kind "progress", "preview", "done", "cancelled" or "failed"; the last three end the request."""

    number: int
    kind: str
    content: Any


class Cancelled(Exception):
    """The request was cancelled."""


class Worker:
    """A process that handles requests one after another.

    Parameters
    ----------
    heard
        Called with each reply, in a thread.
    ended
        Called with the exit code when the process has ended by itself, in a thread.
    """

    def __init__(self, heard: Callable[[Reply], None], ended: Callable[[int | None], None]) -> None:
        context = get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._oldest = context.Value("q", 0)
        self._process = context.Process(target=_serve, args=(theirs, self._oldest), daemon=True)
        self._stopped = False
        with interrupts_blocked():
            self._process.start()
        theirs.close()
        self._waiting: SimpleQueue[Request | None] = SimpleQueue()
        Thread(target=self._pass_on, daemon=True).start()
        Thread(target=self._listen, args=(heard, ended), daemon=True).start()

    def send(self, request: Request) -> None:
        """Queue a request without waiting for the process."""
        self._waiting.put(request)

    def cancel_before(self, number: int) -> None:
        """Cancel denoising requests with lower numbers when they next report their progress."""
        self._oldest.value = number

    def stop(self) -> None:
        """End the process at once; `ended` is not called."""
        self._stopped = True
        self._process.kill()
        self._process.join()

    def _pass_on(self) -> None:
        while (request := self._waiting.get()) is not None:
            try:
                self._ours.send(request)
            except OSError:  # the process has ended, which `ended` tells
                return

    def _listen(self, heard: Callable[[Reply], None], ended: Callable[[int | None], None]) -> None:
        while True:
            try:
                reply = self._ours.recv()
            except (EOFError, OSError):
                break
            heard(reply)
        self._process.join()
        self._waiting.put(None)
        if not self._stopped:
            ended(self._process.exitcode)


def _serve(connection: Connection, oldest: Any) -> None:
    """Handle requests until the connection is closed."""
    end_with_parent()
    from cascadenorm.studio.requests import Requests  # here: the server starts without numerical packages

    requests = Requests()
    while True:
        try:
            request = connection.recv()
        except (EOFError, OSError):
            return
        connection.send(_reply(request, requests.done, _Reports(connection, oldest, request)))


def _reply(request: Request, done: Callable[..., Any], reports: "_Reports") -> Reply:
    """Return the reply that ends a request."""
    try:
        return Reply(request.number, "done", done(request.kind, request.arguments, reports.progress, reports.preview))
    except Cancelled:
        return Reply(request.number, "cancelled", None)
    except CascadenormError as error:
        return Reply(request.number, "failed", _about(error))
    except MemoryError:
        return Reply(request.number, "failed", {"error": "there is not enough memory for this mesh"})
    except Exception as error:
        told = f"{type(error).__name__}: {error} (please report it)"
        return Reply(request.number, "failed", {"error": told})


def _about(error: CascadenormError) -> dict[str, Any]:
    """Return the message of an error, and which files or setting it is about."""
    told: dict[str, Any] = {"error": error.message(spelled), "remedy": error.remedy}
    if isinstance(error, ParameterError):
        told["parameter"] = error.parameter
    if isinstance(error, OutputError):
        told["existing"] = error.existing
    return told


class _Reports:
    """Reports on a request in progress."""

    def __init__(self, connection: Connection, oldest: Any, request: Request) -> None:
        self._connection, self._oldest, self._request = connection, oldest, request
        self._said = 0.0

    def progress(self, fraction: float) -> None:
        """Report the fraction done at intervals; raise Cancelled if the request was cancelled."""
        if self._request.kind == "denoise" and self._request.number < self._oldest.value:
            raise Cancelled
        if monotonic() - self._said >= INTERVAL:
            self._said = monotonic()
            self._connection.send(Reply(self._request.number, "progress", fraction))

    def preview(self, scene: bytes) -> None:
        """Report the scene of a coarse mesh."""
        self._connection.send(Reply(self._request.number, "preview", scene))
