"""Console served on a free port with made-up snapshots, and requests as browsers send them."""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from acquire.console.web.app import make_app
from acquire.console.web.gate import cookie_name
from acquire.console.web.routes import Site
from acquire.console.web.server import WebServer, listen
from acquire.console.web.visitors import Visitors
from tests.acquire.console.web.sample_server import SampleBackend


@dataclass(frozen=True)
class Answer:
    """Answer to a request."""

    status: int
    headers: dict[str, str]
    data: bytes

    @property
    def json(self) -> Any:
        return json.loads(self.data)

    @property
    def kind(self) -> str:
        """Kind of the error."""
        return self.json["error"]["kind"]


@dataclass
class Console:
    """A console that is served, and the browsers of a test."""

    port: int
    visitors: Visitors
    backend: SampleBackend
    cookie: str = ""
    """header Cookie of the operator's browser"""
    sent: list[Answer] = field(default_factory=list)

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.port}"

    def another_cookie(self) -> str:
        """Cookie of a further browser, as the console's one-time address gives it."""
        return f"{cookie_name(self.port)}={self.visitors.redeem(self.visitors.new_token())}"

    def send(
        self, method: str, path: str, body: object = None, change: dict[str, str | None] | None = None
    ) -> Answer:
        """Send a request as the operator's page would, with some headers changed or (None) left out."""
        headers: dict[str, str | None] = {"Host": self.host, "Cookie": self.cookie}
        data = None
        if method == "POST":
            headers |= {"Origin": f"http://{self.host}", "X-Percuss": "1", "Content-Type": "application/json"}
            data = body if isinstance(body, bytes) else json.dumps({} if body is None else body).encode()
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        with contextlib.closing(connection):
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in (headers | (change or {})).items():
                if value is not None:
                    connection.putheader(name, value)
            if data is not None:
                connection.putheader("Content-Length", str(len(data)))
            connection.endheaders(data)
            answer = connection.getresponse()
            return Answer(answer.status, dict(answer.getheaders()), answer.read())

    def get(self, path: str, change: dict[str, str | None] | None = None) -> Answer:
        return self.send("GET", path, change=change)

    def post(self, path: str, body: object = None, change: dict[str, str | None] | None = None) -> Answer:
        return self.send("POST", path, body, change)

    def connected(self) -> socket.socket:
        """Bare connection, on which a test sends what it likes."""
        return socket.create_connection(("127.0.0.1", self.port), timeout=20)


@contextlib.contextmanager
def console(monotonic_s: Callable[[], float] = time.monotonic) -> Iterator[Console]:
    """Serve a console during the block; its operator's browser has the cookie."""
    listener = listen(0)
    port = listener.getsockname()[1]
    visitors, backend = Visitors(monotonic_s), SampleBackend()
    site = Site(backend, visitors, f"http://127.0.0.1:{port}")
    server = WebServer(make_app(site, port, monotonic_s), listener, site.ended)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        while not server.started:
            time.sleep(0.01)
        served = Console(port, visitors, backend)
        served.cookie = served.another_cookie()
        yield served
    finally:
        server.end()
        thread.join()
        site.stopping.shutdown()
