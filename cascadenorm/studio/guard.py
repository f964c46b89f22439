"""Checks of each request: only the studio's own page, in a browser on this machine, may send one."""

import secrets

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data: blob:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content security policy: the page loads nothing from elsewhere, and no other page can embed it in a frame."""

HEADERS = {
    "content-security-policy": POLICY,
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
