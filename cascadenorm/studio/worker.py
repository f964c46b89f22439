"""The studio's worker process: a crash or a lack of memory in it does not end the server.

The process is reused, since starting one and opening a mesh take seconds. A request is cancelled when it next reports
its progress; if it does not do so in time, the process is killed and another one started.
"""

from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from time import monotonic
from typing import Any, NamedTuple

from cascadenorm.errors import CascadenormError, MeshError, OutputError, ParameterError
from cascadenorm.studio import saving
from cascadenorm.studio.settings import spelled
from cascadenorm.studio.workbench import Workbench
from cascadenorm.workers import end_with_parent, interrupts_blocked

INTERVAL = 0.1
"""Seconds between two reports of progress."""


class Request(NamedTuple):
    """Work to be done: kind is "open", "paint", "denoise", "save", "download" or "recipe"."""

    number: int
    kind: str
    arguments: dict[str, Any]


class Reply(NamedTuple):
    """What came of a request: kind is "progress", "preview", "done", "cancelled" or "failed"; the last three end it."""

    number: int
    kind: str
    content: Any


class Cancelled(Exception):
    """The request was cancelled."""


class Worker:
    """A process that does one request after the other.

    Parameters
    ----------
    heard : called with each reply, in a thread
    ended : called when the process has ended by itself, with its exit code, in a thread
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
        """Hand over a request, without waiting until the process takes it."""
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
    work = _Work(connection, oldest)
    while True:
        try:
            request = connection.recv()
        except (EOFError, OSError):
            return
        connection.send(work.done(request))


def _about(error: CascadenormError) -> dict[str, Any]:
    """Return the message of an error, and which files or setting it is about."""
    told: dict[str, Any] = {"error": error.message(spelled), "remedy": error.remedy}
    if isinstance(error, ParameterError):
        told["parameter"] = error.parameter
    if isinstance(error, OutputError):
        told["existing"] = error.existing
    return told


class _Work:
    def __init__(self, connection: Connection, oldest: Any) -> None:
        self._connection, self._oldest = connection, oldest
        self._opened: Workbench | None = None

    @property
    def _bench(self) -> Workbench:
        if self._opened is None:
            raise MeshError("no mesh is open", hint="open one")
        return self._opened

    def done(self, request: Request) -> Reply:
        """Return the reply that ends a request."""
        try:
            return Reply(request.number, "done", self._do(request))
        except Cancelled:
            return Reply(request.number, "cancelled", None)
        except CascadenormError as error:
            return Reply(request.number, "failed", _about(error))
        except MemoryError:
            return Reply(request.number, "failed", {"error": "there is not enough memory for this mesh"})
        except Exception as error:
            told = f"{type(error).__name__}: {error} (please report it)"
            return Reply(request.number, "failed", {"error": told})

    def _do(self, request: Request) -> Any:
        given = request.arguments
        listener = self._listener(request)
        match request.kind:
            case "open":
                self._opened = Workbench(Path(given["path"]), given["name"])
                return self._bench.about()
            case "paint":
                return self._bench.take_paint(given["codes"])
            case "denoise":
                return self._bench.denoise(given["settings"], listener, self._preview(request))
            case "save":
                return saving.save(
                    self._bench, given["settings"], Path(given["target"]), listener, force=given["force"]
                )
            case "download":
                return saving.packed(self._bench, given["settings"], given["name"], listener)
            case "recipe":
                return saving.recipe(self._bench, given["settings"], Path(given["target"]))
        raise ValueError(request.kind)

    def _listener(self, request: Request) -> Callable[[float], None]:
        said = 0.0

        def listen(fraction: float) -> None:
            nonlocal said
            if request.kind == "denoise" and request.number < self._oldest.value:
                raise Cancelled
            if monotonic() - said >= INTERVAL:
                said = monotonic()
                self._connection.send(Reply(request.number, "progress", fraction))

        return listen

    def _preview(self, request: Request) -> Callable[[bytes], None]:
        return lambda scene: self._connection.send(Reply(request.number, "preview", scene))
