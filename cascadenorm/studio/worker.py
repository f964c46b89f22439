"""Requests to the studio's worker process: a crash or a lack of memory in it does not end the server.

The process is reused, since starting one and opening a mesh take seconds. A request is cancelled when it next reports
its progress; if it does not do so in time, the process is killed and another one started.
"""

from collections.abc import Callable
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from queue import SimpleQueue
from threading import Thread
from time import monotonic
from typing import Any, NamedTuple

from cascadenorm.errors import CascadenormError, OutputError, ParameterError, WorkerError
from cascadenorm.execution.progress import Cancelled
from cascadenorm.execution.worker_processes import Worker, received
from cascadenorm.studio.names import setting_name

INTERVAL = 0.1  # seconds between two reports of progress


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


class Channel:
    """Requests to a worker process and its replies; they pass in threads, so that the server never waits for them.

    In a thread, `heard` is called with each reply, and `ended`, with the error that tells why, when the process has
    ended by itself.
    """

    def __init__(self, heard: Callable[[Reply], object], ended: Callable[[WorkerError], object]) -> None:
        self._oldest = get_context("spawn").Value("q", 0)
        self._worker: Worker[Request, Reply] = Worker(partial(_serve, oldest=self._oldest))
        self._stopped = False
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
        self._worker.kill()

    def _pass_on(self) -> None:
        while (request := self._waiting.get()) is not None:
            self._worker.send(request)

    def _listen(self, heard: Callable[[Reply], object], ended: Callable[[WorkerError], object]) -> None:
        try:
            while True:
                heard(self._worker.receive())
        except WorkerError as error:
            self._worker.kill()
            self._waiting.put(None)
            if not self._stopped:
                ended(error)


def _serve(connection: Connection, oldest: Any) -> None:
    """Handle requests until the connection is closed."""
    from cascadenorm.studio.requests import Requests  # here: the server starts without numerical packages

    requests = Requests()
    for request in received(connection):
        connection.send(_reply(connection, oldest, request, requests.done))


def _reply(connection: Connection, oldest: Any, request: Request, done: Callable[..., Any]) -> Reply:
    """Return the reply that ends a request. Progress and previews are sent before."""
    said = 0.0

    def progress(fraction: float) -> None:
        nonlocal said
        if request.kind == "denoise" and request.number < oldest.value:
            raise Cancelled
        if monotonic() - said >= INTERVAL:
            said = monotonic()
            connection.send(Reply(request.number, "progress", fraction))

    def preview(scene: bytes) -> None:
        connection.send(Reply(request.number, "preview", scene))

    try:
        return Reply(request.number, "done", done(request.kind, request.arguments, progress, preview))
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
    told: dict[str, Any] = {"error": error.message(setting_name), "remedy": error.remedy}
    if isinstance(error, ParameterError):
        told["parameter"] = error.parameter
    if isinstance(error, OutputError):
        told["existing"] = error.existing
    return told
