"""The server of the studio, on the loopback interface, for the studio's own page only."""

import asyncio
import os
import secrets
import socket
import webbrowser
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from os import PathLike, fspath
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cascadenorm.errors import OutputError, ReadError
from cascadenorm.studio.application import Application
from cascadenorm.studio.session import Session
from cascadenorm.studio.uploads import Uploads, check_size

HOST = "127.0.0.1"
SERVER_SETTINGS: dict[str, Any] = {
    "log_level": "critical",
    "access_log": False,
    "ws": "none",
    "http": "h11",
    "loop": "asyncio",
    "server_header": False,
    "timeout_graceful_shutdown": 1,
}
LOADING_S = 60.0  # seconds from the first request until a page has to listen for events
RELOADING_S = 3.0  # seconds after which the studio ends when its last page was closed; a reload takes less
AWAITING_S = 3600.0
"""Seconds after which the studio ends when the connection was lost: browsers discard background tabs."""
CHECKING_S = 0.2  # seconds between checks for open pages


def serve(file: str | PathLike[str] | None, *, port: int, browser: bool, most: float) -> None:
    """Serve until the last page is closed; parameters as in `studio`, with `most` in bytes."""
    if file is not None:
        _check_file(Path(file), most)
    listening = _listening(port)
    token, session = secrets.token_urlsafe(32), Session()
    with TemporaryDirectory(prefix="cascadenorm-studio-") as folder, listening:

        @asynccontextmanager
        async def working(_: Starlette) -> AsyncIterator[None]:
            session.ready()
            tasks = [asyncio.create_task(_end_without_pages(session, server))]
            if file is not None:
                tasks.append(asyncio.create_task(session.open_given(Path(file).absolute(), fspath(file))))
            try:
                yield
            finally:
                for task in tasks:
                    task.cancel()
                session.close()

        routes = Application(session, Uploads(Path(folder), most=most)).routes()
        port = listening.getsockname()[1]
        guarded = Guard(Starlette(routes=routes, lifespan=working), port=port, token=token)
        server = Server(uvicorn.Config(guarded, **SERVER_SETTINGS), session)
        address = f"http://{HOST}:{port}/#token={token}"
        print(f"The studio is at {address}\nClose its page, or press Ctrl-C, to end it.", flush=True)
        if browser:
            webbrowser.open(address)
        server.run(sockets=[listening])


class Server(uvicorn.Server):
    """A server that ends the events of its pages first, for whose end it would wait otherwise."""

    def __init__(self, config: uvicorn.Config, session: Session) -> None:
        super().__init__(config)
        self._session = session

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._session.end_pages()
        await super().shutdown(sockets)


async def _end_without_pages(session: Session, server: uvicorn.Server) -> None:
    """End the server when no page has been open for a while, once a page has sent a request."""
    while not session.requests:
        await asyncio.sleep(CHECKING_S)
    listened, seen, gone = False, session.requests, 0.0
    while gone < (LOADING_S if not listened else AWAITING_S if session.is_awaited else RELOADING_S):
        await asyncio.sleep(CHECKING_S)
        listened = listened or session.has_listened
        gone = 0.0 if session.has_pages or session.requests > seen else gone + CHECKING_S
        seen = session.requests
    server.should_exit = True


def _check_file(path: Path, most: float) -> None:
    """Raise the errors of `denoise` for a file that is too large or no mesh; the page isolates invalid vertices."""
    from cascadenorm import io  # here: loads the numerical packages
    from cascadenorm.io.atomic import is_special
    from cascadenorm.io.interop import mesh_of_file

    if os.path.isfile(path):
        check_size(str(path), path.stat().st_size, most, most)
    elif is_special(path):
        raise ReadError(f"{path} is a pipe or a device", hint="give the name of a mesh file")
    file = io.read(path)
    if not len(file.polygons):
        mesh_of_file(file, str(path))  # raises MeshError


def _listening(port: int) -> socket.socket:
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
        listening.listen()  # a browser that is faster than the server waits
    except (OSError, OverflowError) as error:
        listening.close()
        why = getattr(error, "strerror", None) or error
        raise OutputError(f"port {port} cannot be used: {why}", hint="choose another one, or leave it out") from None
    return listening


STUDIO_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data: blob:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy: the page loads nothing from elsewhere, and no other page can embed it in a frame."""

HEADERS = {
    "content-security-policy": STUDIO_POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


class Guard:
    """An application, on a port of this machine, whose requests are checked first.

    `Host` must be this machine, which it is not after DNS rebinding. `Origin`, if it is sent, must be the studio's own
    page, and requests that change something must send it (CSRF). Requests under /api must carry the token, which only
    the printed address contains.
    """

    def __init__(self, app: ASGIApp, *, port: int, token: str) -> None:
        self._app, self._token = app, token
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        if port == 80:
            self._hosts |= {"127.0.0.1", "localhost"}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Reject a request or pass it on; every response has the security headers."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, send_guarded)
        else:
            code, error = refusal
            await JSONResponse({"error": error}, code)(scope, receive, send_guarded)

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        headers = Headers(scope=scope)
        host, origin = headers.get("host", ""), headers.get("origin")
        if host not in self._hosts:
            return 403, f"the host is {host!r}; the studio answers only at 127.0.0.1 and localhost"
        reads = scope["method"] in ("GET", "HEAD")
        if origin != f"http://{host}" and not (origin is None and reads):
            return 403, f"the origin is {origin!r}; only the studio's own page may send requests"
        if scope["path"].startswith("/api/"):
            if headers.get("sec-fetch-site", "same-origin") != "same-origin":
                return 403, "the request comes from another site; only the studio's own page may send requests"
            given = headers.get("authorization", "").removeprefix("Bearer ")
            if not secrets.compare_digest(given.encode(), self._token.encode()):
                return 401, "the token is wrong: open the address that the studio printed"
        return None
