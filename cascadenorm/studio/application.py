"""Handlers for the requests of the studio's page."""

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import quote

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Route

from cascadenorm.errors import CascadenormError, ParameterError, ReadError
from cascadenorm.studio.names import plain_name, setting_name
from cascadenorm.studio.session import RequestFailed, Session
from cascadenorm.studio.uploads import TooLarge, Uploads

MOST_REQUEST_BYTES = 1 << 20  # largest size of a JSON request, in bytes
MOST_TICKET = 100  # largest length of the ticket by which a page identifies its request, or itself
MOST_DIGITS = 20  # length from which a number in a path was not given out
PULSE = 1.0  # seconds without an event after which a comment is sent, so that a closed page is noticed

ASSETS = {
    "/": ("studio/studio.html", "text/html"),
    "/studio.css": ("studio/studio.css", "text/css"),
    "/studio.js": ("studio/studio.js", "text/javascript"),
    "/viewer.css": ("reports/report.css", "text/css"),
    "/viewer.js": ("reports/viewer.js", "text/javascript"),
}
"""Static files of the page: for each path the file in the package, and the media type."""

Handler = Callable[[Request], Awaitable[Response | dict[str, Any] | None]]
"""Answers a request with a response, or with the content of a JSON object, which is empty for None."""


class Json(JSONResponse):
    """JSON in ASCII, which can also hold file names that are not valid Unicode."""

    def render(self, content: Any) -> bytes:
        return json.dumps(content, allow_nan=False, separators=(",", ":")).encode()


class Application:
    """The requests of the page, with the state that pages share and the storage for dropped files."""

    def __init__(self, session: Session, uploads: Uploads) -> None:
        self._session, self._uploads = session, uploads
        self._drops = 0
        self._saved: list[str] = []

    def routes(self) -> list[Route]:
        asked: dict[str, tuple[str, Handler]] = {
            "/api/form": ("GET", self.form),
            "/api/events": ("GET", self.events),
            "/api/scene/{number}": ("GET", self.scene),
            "/api/drop": ("POST", self.drop),
            "/api/drop/{number}": ("POST", self.take),
            "/api/open": ("POST", self.open),
            "/api/paint": ("POST", self.paint),
            "/api/kept-paint": ("GET", self.kept_paint),
            "/api/leave": ("POST", self.leave),
            "/api/denoise": ("POST", self.denoise),
            "/api/cancel": ("POST", self.cancel),
            "/api/recipe": ("POST", self.recipe),
            "/api/save": ("POST", self.save),
            "/api/saved/{number}": ("GET", self.saved),
            "/api/download": ("POST", self.download),
        }
        asked |= {path: ("GET", _asset(*asset)) for path, asset in ASSETS.items()}
        return [Route(path, self._answering(handler), methods=[method]) for path, (method, handler) in asked.items()]

    def _answering(self, handler: Handler) -> Callable[[Request], Awaitable[Response]]:
        """Count requests, so that the server notices a page that is loading, and return errors as JSON responses."""

        async def answering(request: Request) -> Response:
            self._session.requests += 1
            try:
                answer = await handler(request)
                return answer if isinstance(answer, Response) else Json(answer or {})
            except RequestFailed as error:
                return Json(error.content, 400)
            except CascadenormError as error:
                return Json({"error": error.message(setting_name)}, 413 if isinstance(error, TooLarge) else 400)

        return answering

    async def form(self, _: Request) -> dict[str, Any]:
        """Return the methods and controls."""
        return await self._session.form()

    async def events(self, request: Request) -> Response:
        """Send events until the page is closed or the server ends."""

        async def lines() -> AsyncIterator[str]:
            async with self._session.page() as events:
                while not await request.is_disconnected():
                    try:
                        event = await asyncio.wait_for(events.get(), PULSE)
                    except asyncio.TimeoutError:
                        yield ":\n\n"
                        continue
                    if event is None:
                        return
                    yield f"data: {json.dumps(event)}\n\n"

        return StreamingResponse(lines(), media_type="text/event-stream")

    async def scene(self, request: Request) -> Response:
        """Return a scene by its number from an event."""
        scene = self._session.scenes.get(_number(request))
        if scene is None:
            raise HTTPException(404)
        return Response(scene, media_type="application/json")

    async def drop(self, _: Request) -> dict[str, Any]:
        """Return a number for files that are dropped together."""
        self._drops += 1
        return {"drop": self._drops}

    async def take(self, request: Request) -> None:
        """Receive one of the dropped files."""
        length = request.headers.get("content-length", "0")
        await self._uploads.take(
            self._known_drop(_number(request)),
            request.query_params.get("name"),
            request.stream(),
            announced=int(length) if length.isdecimal() else 0,
        )

    async def open(self, request: Request) -> None:
        """Open the first file of a drop whose name is that of a mesh."""
        given = await _json(request)
        drop, names = self._known_drop(given.get("drop")), given.get("names")
        if not isinstance(names, list) or not names:
            raise ParameterError("the request names no file")
        paths = [self._uploads.path(drop, name) for name in names]
        self._session.cancel()  # the worker handles one request at a time
        path = paths[await self._session.ask("which", names=[path.name for path in paths])]
        if not path.is_file():
            raise ReadError(f"{path.name} was not received", hint="drop it again")
        try:
            await self._session.open(path, path.name, saves=False)
        except RequestFailed:
            self._uploads.refused(drop)
            raise
        self._uploads.opened(drop)

    async def paint(self, request: Request) -> None:
        """Receive a code for each displayed vertex."""
        shown = self._session.opened.get("painted", 0)
        page = request.query_params.get("page", "")[:MOST_TICKET]
        await self._session.paint(await _body(request, shown), page)

    async def kept_paint(self, _: Request) -> Response:
        """Return the paint on the open mesh, for a page that was discarded or reloaded."""
        return Response(self._session.painted, media_type="application/octet-stream")

    async def leave(self, _: Request) -> None:
        """Record that the page was closed; a page that disconnects without this was discarded and may return."""
        self._session.leave()

    async def denoise(self, request: Request) -> None:
        """Start denoising; events report its progress and result."""
        given = await _json(request)
        self._session.denoise(_of(given), str(given.get("ticket", ""))[:MOST_TICKET])

    async def cancel(self, _: Request) -> None:
        self._session.cancel()

    async def recipe(self, request: Request) -> dict[str, Any]:
        """Return the command line and the Python call for a result."""
        given = await _json(request)
        target = self._target(given.get("name"))
        found: dict[str, Any] = await self._session.ask("recipe", settings=_of(given), target=str(target))
        return found

    async def save(self, request: Request) -> dict[str, Any]:
        """Save a result beside the file that was opened."""
        given = await _json(request)
        target, force = self._target(given.get("name")), given.get("force") is True
        if not self._session.opened.get("saves"):
            raise ParameterError("a dropped file has no folder to save to", hint="download the result")
        done = await self._session.ask("save", settings=_of(given), target=str(target), force=force)
        self._saved += [path for path in done["files"] if path not in self._saved]
        files = [{"path": path, "number": self._saved.index(path)} for path in done["files"]]
        return {**done, "files": files}

    async def saved(self, request: Request) -> Response:
        """Return a file that was saved in this session, by its number from `save`."""
        number = _number(request)
        if not 0 <= number < len(self._saved):
            raise HTTPException(404)
        if not Path(self._saved[number]).is_file():
            raise ReadError(f"{self._saved[number]} is no longer there", hint="save the result again")
        return FileResponse(self._saved[number], media_type="application/octet-stream")

    async def download(self, request: Request) -> Response:
        """Return a result as a file to download."""
        given = await _json(request)
        name = plain_name(given.get("name"))
        done = await self._session.ask("download", settings=_of(given), name=name)
        about = {key: done[key] for key in ("name", "files", "left_out", "command", "python")}
        headers = {"x-about": quote(json.dumps(about))}
        return Response(done["content"], media_type="application/octet-stream", headers=headers)

    def _known_drop(self, drop: Any) -> int:
        if not isinstance(drop, int) or not 0 < drop <= self._drops:
            raise ParameterError("nothing was dropped: drop a file")
        return drop

    def _target(self, name: Any) -> Path:
        """Return a path beside the open file as the user gave it; for a dropped file, a bare name."""
        if self._session.file is None:
            raise ParameterError("no mesh is open: open one")
        _, shown = self._session.file
        return Path(shown).with_name(plain_name(name))


def _asset(name: str, kind: str) -> Handler:
    content = files("cascadenorm").joinpath(name).read_bytes()

    async def handler(_: Request) -> Response:
        return Response(content, media_type=kind)

    return handler


def _number(request: Request) -> int:
    """Return the number in the path of a request; -1 if it is none, or longer than any that was given out."""
    text = request.path_params["number"]
    return int(text) if text.isdecimal() and len(text) < MOST_DIGITS else -1


async def _body(request: Request, most: int) -> bytes:
    parts, size = [], 0
    async for part in request.stream():
        size += len(part)
        if size > most:
            raise TooLarge(f"the request has more than {most} bytes")
        parts.append(part)
    return b"".join(parts)


async def _json(request: Request) -> dict[str, Any]:
    text = await _body(request, MOST_REQUEST_BYTES)
    try:
        given = json.loads(text)
        json.dumps(given, ensure_ascii=False).encode()  # refuses half of a surrogate pair, which no file name can hold
    except (ValueError, RecursionError):
        given = None
    if not isinstance(given, dict):
        raise ParameterError("the request is not a JSON object of valid text")
    return given


def _of(given: dict[str, Any]) -> dict[str, Any]:
    settings = given.get("settings")
    if not isinstance(settings, dict):
        raise ParameterError("the request has no settings")
    return settings
