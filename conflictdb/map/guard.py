"""Control access: pages of this server, in a browser on this machine or at the path with the token.

Requests of other sites are refused before anything is read: by Host (another site's name that resolves to this address:
DNS rebinding), by Origin and by Sec-Fetch-Site. Only pages of this server may use the answers. Writing requests also
need a secret that only such a page can read.

The token is the first part of each path, so a browser sends it to this server alone.
"""

import secrets
from dataclasses import dataclass, field
from typing import Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HTTP_PORT: Final = 80
SECRET_HEADER: Final = "x-conflictdb-secret"  # noqa: S105 (its name)

_POLICY: Final = "; ".join((
    "default-src 'none'",
    "script-src 'self' 'wasm-unsafe-eval'",  # the kernel; no text is evaluated
    "worker-src 'self'",
    "style-src 'self'",
    "img-src 'self' data: blob:",
    "connect-src 'self'",
    "base-uri 'none'",
    "form-action 'none'",
    "frame-ancestors 'none'",
))  # fmt: skip
_HEADERS: Final = {
    "Content-Security-Policy": _POLICY,
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}


@dataclass(frozen=True, slots=True)
class Access:
    """Access rights.

    hosts : allowed Host headers, lower case; not checked on a server with a `token`, which others reach
    token : first part of each path, which opens the page from other machines; None: only this machine has access
    secret : required in writing requests; the page reads it from the server
    """

    hosts: frozenset[str]
    token: str | None
    secret: str = field(default_factory=lambda: secrets.token_urlsafe(24))

    @property
    def root(self) -> str:
        """The path of the page."""
        return "/" if self.token is None else f"/{self.token}/"


def local_hosts(port: int, *more: str) -> frozenset[str]:
    """Return the Host headers of pages that a browser on this machine opens at a port.

    more : further names and addresses that the server listens at
    """
    names = {"127.0.0.1", "localhost", "::1", *(name.lower() for name in more)}
    shown = [f"[{name}]" if ":" in name else name for name in names]
    # Browsers omit the default port of http.
    return frozenset(f"{name}:{port}" for name in shown).union(shown if port == HTTP_PORT else [])


class Guard:
    """ASGI middleware that forwards only permitted requests."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a refusal, or forward the request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        below = self._below(scope["path"])
        if below is not None:
            scope = {**scope, "path": below}
        refusal = self._refusal(scope, Headers(scope=scope), is_below=below is not None)

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(_HEADERS)
            await send(message)

        answer = self._app if refusal is None else JSONResponse({"error": refusal}, 403)
        await answer(scope, receive, guarded)

    def _below(self, path: str) -> str | None:
        """Return a path below the root of the page, None if it is elsewhere."""
        root = self._access.root
        given = path[: len(root)].encode()
        return "/" + path[len(root) :] if secrets.compare_digest(given, root.encode()) else None

    def _refusal(self, scope: Scope, headers: Headers, *, is_below: bool) -> str | None:
        """Return why a request is refused, None if it is permitted; is_below : whether its path is the page's."""
        access = self._access
        host = headers.get("host", "").lower()
        # Other sites may link to the page itself; that reveals nothing to them.
        is_link = scope["method"] == "GET" and scope["path"] == "/" and headers.get("sec-fetch-dest") == "document"
        if access.token is None and host not in access.hosts:
            return "this server answers to its own name alone"
        if len(headers.getlist("host")) != 1:
            return "one Host is needed"
        if any(origin.lower() not in (f"http://{host}", f"https://{host}") for origin in headers.getlist("origin")):
            return "another site asks"
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin") and not is_link:
            return "another site asks"
        if not is_below:
            return "open the address that `conflictdb map` printed, with its token"
        if scope["method"] not in ("GET", "HEAD"):
            return self._refusal_to_change(headers)
        return None

    def _refusal_to_change(self, headers: Headers) -> str | None:
        if not secrets.compare_digest(headers.get(SECRET_HEADER, "").encode(), self._access.secret.encode()):
            return "only the page itself may change something"
        if headers.get("content-type") != "application/json":
            return "JSON is needed"
        return None
