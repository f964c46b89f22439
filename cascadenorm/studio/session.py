"""State shared by the pages of one studio: the open mesh, the running work, and the pages that get events."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import count
from pathlib import Path
from time import monotonic
from typing import Any

from cascadenorm.errors import WorkerError
from cascadenorm.studio.worker import Channel, Reply, Request

CANCEL_TIMEOUT_S = 3.0  # seconds after which the process of cancelled work is killed if it has not ended

Event = dict[str, Any]
"""Sent to the pages, as JSON.

`type` is "empty", "opening", "opened", "unopened", "painted", "progress", "shown", "cancelled" or "failed".
"""


class RequestFailed(Exception):
    """A request failed in the worker; `content` has the message as "error", and a remedy if there is one."""

    def __init__(self, content: dict[str, Any]) -> None:
        super().__init__(content["error"])
        self.content = content


class Session:
    """The worker and its mesh, for use in the event loop in which it is started."""

    def __init__(self) -> None:
        self._numbers = count(1)
        self._waiting: dict[int, tuple[Request, asyncio.Future[Any], float]] = {}
        self._pages: set[asyncio.Queue[Event | None]] = set()
        self.file: tuple[Path, str] | None = None
        """The path of the open file, and its name in messages."""
        self._digest = ""  # of the open file
        self.painted = b""
        """The paint on the open mesh, one code for each displayed vertex; empty if there is none."""
        self.opened: Event = {"type": "empty"}
        """The last event about the open file; `empty` if none was given."""
        self.scenes: dict[int, bytes] = {}
        self.requests = 0
        self.has_listened = False
        self._lost = 0
        self._worker: Channel | None = None
        self._form: dict[str, Any] | None = None

    # work

    async def form(self) -> dict[str, Any]:
        """Return the description of the form; raise RequestFailed if the worker ends first."""
        if self._form is None:
            self._form = await self.ask("form")
        return self._form

    async def open(self, path: Path, name: str, *, saves: bool) -> None:
        """Replace the open mesh, unless RequestFailed is raised; `saves` if results can be saved beside the file."""
        self.cancel()
        about = await self.ask("open", path=str(path), name=name)
        self.file, self.painted, self.scenes = (path, name), b"", {}
        self._digest = about.pop("digest")
        self.opened = {"type": "opened", **about, "saves": saves, "scene": self._keep(about["scene"])}
        self._tell(self.opened)

    async def open_given(self, path: Path, name: str) -> None:
        """Open the file given at the start, and send events about that to the pages."""
        self.opened = {"type": "opening", "name": Path(name).name}
        self._tell(self.opened)
        try:
            await self.form()  # the page cannot show anything without it
            await self.open(path, name, saves=True)
        except RequestFailed as error:
            self.opened = {"type": "unopened", **error.content}
            self._tell(self.opened)

    def denoise(self, settings: dict[str, Any], ticket: str) -> None:
        """Cancel running work and start denoising; events have the ticket of the page."""
        self._cancel_before(self._send("denoise", settings=settings, ticket=ticket))

    def cancel(self) -> None:
        """End denoising."""
        self._cancel_before(next(self._numbers))

    async def paint(self, codes: bytes, page: str) -> None:
        """Set the paint and cancel running work; tell the pages which of them has changed it."""
        self.cancel()
        await self.ask("paint", codes=codes)
        changed = codes != (self.painted or bytes(len(codes)))
        self.painted = codes
        if changed:
            self._tell({"type": "painted", "page": page})

    async def ask(self, kind: str, **arguments: Any) -> Any:
        """Return the worker's answer to a request; raises RequestFailed."""
        number = self._send(kind, **arguments)
        return await self._waiting[number][1]

    def close(self) -> None:
        """End the worker."""
        if self._worker is not None:
            self._worker.stop()

    # pages

    @property
    def has_pages(self) -> bool:
        return bool(self._pages)

    @property
    def is_awaited(self) -> bool:
        """Whether a page has disconnected without leaving, as tabs do that the browser discards."""
        return self._lost > 0

    def leave(self) -> None:
        """Record that a page was closed or reloaded; its connection ends before or after."""
        self._lost -= 1

    @asynccontextmanager
    async def page(self) -> AsyncIterator[asyncio.Queue[Event | None]]:
        """Yield a queue of events for one page; the first event is about the open file, and None ends them."""
        events: asyncio.Queue[Event | None] = asyncio.Queue()
        events.put_nowait(self.opened)
        self._pages.add(events)
        self.has_listened = True
        self._lost -= self._lost > 0  # it may be the one that was lost
        try:
            yield events
        finally:
            self._pages.discard(events)
            self._lost += 1

    def end_pages(self) -> None:
        """End the events of all pages, since the server ends."""
        self._tell(None)

    def _tell(self, event: Event | None) -> None:
        for page in self._pages:
            page.put_nowait(event)

    # the worker

    def _send(self, kind: str, **arguments: Any) -> int:
        worker = self.ready()
        request = Request(next(self._numbers), kind, arguments)
        future = asyncio.get_running_loop().create_future()
        future.add_done_callback(lambda done: done.cancelled() or done.exception())  # possibly nothing waits for it
        self._waiting[request.number] = (request, future, monotonic())
        worker.send(request)
        return request.number

    def ready(self) -> Channel:
        """Return the worker; if there is none, start one, which takes a second, and open the current file in it."""
        if self._worker is None:
            soon = asyncio.get_running_loop().call_soon_threadsafe
            self._worker = Channel(lambda reply: soon(self._heard, reply), lambda error: soon(self._ended, error))
            if self.file is not None:
                path, name = self.file
                self._send("reopen", path=str(path), name=name, digest=self._digest)
                if self.painted:
                    self._send("paint", codes=self.painted)
        return self._worker

    def _cancel_before(self, number: int) -> None:
        if self._worker is not None:
            self._worker.cancel_before(number)
        outdated = [one for one, (request, *_) in self._waiting.items() if request.kind == "denoise" and one < number]
        if outdated:
            asyncio.get_running_loop().call_later(CANCEL_TIMEOUT_S, self._kill_unresponsive, outdated)

    def _kill_unresponsive(self, numbers: list[int]) -> None:
        """Kill a worker that still runs cancelled requests; a new one gets the requests sent since."""
        if self._worker is None or not self._waiting.keys() & set(numbers):
            return
        self._worker.stop()
        self._worker = None
        for number in sorted(self._waiting.keys() & set(numbers)):
            self._heard(Reply(number, "cancelled", None))
        for request, *_ in list(self._waiting.values()):
            self.ready().send(request)

    def _heard(self, reply: Reply) -> None:
        if reply.number not in self._waiting:
            return
        request, future, since = self._waiting[reply.number]
        if reply.kind in ("done", "failed", "cancelled"):
            del self._waiting[reply.number]
        elif reply.kind == "preview" or reply.content == 0.0:  # the time left is counted from here
            self._waiting[reply.number] = (request, future, since := monotonic())
        if future.done():  # nothing waits for it any more
            pass
        elif reply.kind == "failed":
            future.set_exception(RequestFailed(reply.content))
        elif reply.kind == "done":
            future.set_result(reply.content)
        if request.kind == "denoise":
            self._tell(self._event(request, reply, since))

    def _event(self, request: Request, reply: Reply, since: float) -> Event:
        """Return the event for a reply to a denoising request."""
        event: Event = {"ticket": request.arguments["ticket"]}
        match reply.kind:
            case "progress":
                passed, fraction = monotonic() - since, reply.content
                left = passed * (1 - fraction) / fraction if fraction > 0.02 else None
                return {"type": "progress", **event, "fraction": fraction, "left": left}
            case "preview":
                return {"type": "shown", **event, "coarse": True, "scene": self._keep(reply.content)}
            case "done":
                about = {**reply.content, "scene": self._keep(reply.content["scene"])}
                return {"type": "shown", **event, "coarse": False, **about}
            case "failed":
                return {"type": "failed", **event, **reply.content}
        return {"type": "cancelled", **event}

    def _ended(self, error: WorkerError) -> None:
        """Fail all pending requests; the next request starts another worker, which opens the same file."""
        self._worker = None
        content = {"error": f"{error.message()}. The next request starts another process."}
        for number in list(self._waiting):
            self._heard(Reply(number, "failed", content))

    def _keep(self, scene: bytes) -> int:
        """Keep a scene until there are two newer ones, apart from the first; return its number."""
        number = next(self._numbers)
        self.scenes[number] = scene
        for old in sorted(self.scenes)[1:-2]:
            del self.scenes[old]
        return number
