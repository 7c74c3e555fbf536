"""Gate before all routes: lets in who has the cookie, and nothing that another site made a browser send.

Against DNS rebinding the header Host is compared with the console's own addresses. Against requests that
other sites make a browser send, Origin is compared with Host, every POST carries a header that only scripts
of the same origin can set, and the cookie is SameSite=Strict.
"""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse, RedirectResponse, Response

from acquire.console.web.rate_limit import TokenBucket
from acquire.console.web.refusal import Refusal
from acquire.console.web.visitors import Visitor, Visitors

Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[MutableMapping[str, Any], Receive, Send], Awaitable[None]]

ORDER_HEADER = "x-percuss"
"""header that every POST carries, with the value 1: a page of another origin cannot set it unasked"""
STOP_PATH = "/api/stop"
KNOWN = "percuss.known"
"""entry of the ASGI scope: True once the request has shown a valid cookie"""
STRANGER_LIMIT = (50.0, 200)
"""requests per second, and burst, of all who show no valid cookie together"""
CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "font-src 'self'; manifest-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
"""Content-Security-Policy of all pages but reports"""
HEADERS = {
    "content-security-policy": CONTENT_POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
    "cache-control": "no-store",
}
"""headers of every answer; a route may replace them by its own"""


def cookie_name(port: int) -> str:
    """Name of the console's cookie; it holds the port, because cookies do not distinguish ports."""
    return f"percuss_console_{port}"


class Gate:
    """ASGI application that checks every request before the routes see it.

    Args:
        app: application behind the gate.
        visitors: register of browsers and scripts.
        port: port on which the console is served.
        monotonic_s: function that returns a monotonic time [s].
    """

    def __init__(
        self, app: App, visitors: Visitors, port: int, monotonic_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._app, self._visitors = app, visitors
        self._cookie = cookie_name(port)
        self._hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}
        self._strangers = TokenBucket(*STRANGER_LIMIT, monotonic_s)

    async def __call__(self, scope: MutableMapping[str, Any], receive: Receive, send: Send) -> None:
        """Check one request, and pass it on or refuse it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return
        guarded = _with_headers(send)
        try:
            answer = self._examine(scope)
        except Refusal as refusal:
            answer = JSONResponse(refusal.body(), refusal.status, headers={"connection": "close"})
        if answer is not None:
            await answer(scope, receive, guarded)
            return
        await self._app(scope, receive, guarded)

    def _examine(self, scope: MutableMapping[str, Any]) -> Response | None:
        """Answer to a request that does not pass; None if it passes.

        Raises:
            Refusal: the request is not allowed.
        """
        headers = Headers(scope=scope)
        visitor = self._visitor(headers)
        if visitor is None and not self._strangers.take():
            raise Refusal(429, "TooMany", "too many requests without a valid cookie", "wait a second")
        host = self._check_host(headers)
        self._check_origin(headers, host, scope["method"])
        if scope["method"] == "GET" and scope["path"] == "/" and (token := _token(scope)):
            return self._let_in(token)
        if visitor is None:
            raise Refusal(
                401,
                "NotLetIn",
                "this browser was not let in, or the console was started again",
                "open the address that `acquire console` prints; each works once",
            )
        scope[KNOWN] = True
        _check_rate(visitor, scope)
        scope["visitor"] = visitor
        return None

    def _visitor(self, headers: Headers) -> Visitor | None:
        authorization = headers.get("authorization", "")
        if authorization.startswith("Bearer "):
            return self._visitors.find_script(authorization.removeprefix("Bearer "))
        try:
            cookies = SimpleCookie(headers.get("cookie", ""))
        except CookieError:
            return None
        morsel = cookies.get(self._cookie)
        return None if morsel is None else self._visitors.find(morsel.value)

    def _check_host(self, headers: Headers) -> str:
        hosts = headers.getlist("host")
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            raise Refusal(
                421,
                "WrongHost",
                "the console is not reached by this name",
                f"use http://{min(self._hosts)}; through an SSH tunnel keep the port: docs/how-to/console.md",
            )
        return hosts[0]

    def _check_origin(self, headers: Headers, host: str, method: str) -> None:
        """Refuse what another site made the browser send.

        Raises:
            Refusal: Origin or Sec-Fetch-Site name another site, or a POST lacks Origin or X-Percuss.
        """
        if method not in {"GET", "HEAD", "POST"}:
            raise Refusal(405, "WrongMethod", "only GET and POST are served")
        origins = headers.getlist("origin")
        if any(origin != f"http://{host}" for origin in origins) or len(origins) > 1:
            raise Refusal(403, "WrongOrigin", "the request comes from another site")
        # A person who opens the printed address comes from no site ("none").
        if headers.get("sec-fetch-site", "none") not in {"same-origin", "none"}:
            raise Refusal(403, "WrongOrigin", "the request comes from another site")
        if method == "POST":
            if not origins:
                raise Refusal(403, "NoOrigin", "an order needs the header Origin")
            if headers.getlist(ORDER_HEADER) != ["1"]:
                raise Refusal(403, "NoOrderHeader", "an order needs the header X-Percuss: 1")

    def _let_in(self, token: str) -> Response:
        """Answer to a one-time token: the cookie, and a redirect to the address without the token.

        Raises:
            Refusal: the token is unknown, or was used before.
        """
        secret = self._visitors.redeem(token)
        if secret is None:
            raise Refusal(
                403, "TokenUsed", "this address was used before, or is of another console", "use a new one"
            )
        answer = RedirectResponse("/", 303)
        answer.set_cookie(self._cookie, secret, httponly=True, samesite="strict", path="/")
        return answer


def _token(scope: MutableMapping[str, Any]) -> str:
    values = parse_qs(scope["query_string"].decode("latin-1"), max_num_fields=8).get("token", [])
    return values[0] if values else ""


def _check_rate(visitor: Visitor, scope: MutableMapping[str, Any]) -> None:
    """Take a token of the visitor's bucket for this kind of request.

    Raises:
        Refusal: there is none.
    """
    bucket = visitor.reading
    if scope["method"] == "POST":
        bucket = visitor.stops if scope["path"] == STOP_PATH else visitor.orders
    if not bucket.take():
        raise Refusal(429, "TooMany", "too many requests from this browser", "wait a second")


def _with_headers(send: Send) -> Send:
    """Function that sends an answer with HEADERS, and without the name of the server."""

    async def guarded(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return guarded
