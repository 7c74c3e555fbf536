"""Console without a rig: serves the pages under the console's rules, with snapshots from `snapshots.py`."""

from __future__ import annotations

import http.server
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2

from acquire.console.web import __file__ as web_file
from tests.acquire.console.web.pages import results, snapshots
from tests.source_tree import ROOT

STATIC = Path(web_file).parent / "static"
CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}


def camera_image() -> bytes:
    """JPEG of the virtual rig's carton."""
    from acquire.virtual.objects import load_object
    from tests.acquire.virtual.test_render import SEED, STATION, Renderer, picture, tipped

    carton = load_object("carton", SEED)
    image = picture(Renderer(carton, STATION, SEED), tipped(carton, 0.0))
    return cv2.imencode(".jpg", image)[1].tobytes()


class SampleConsole(http.server.ThreadingHTTPServer):
    """Console that shows one snapshot until it is given the next, and records the orders it gets."""

    daemon_threads = True

    def __init__(self, image: bytes = b"") -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.url = f"http://127.0.0.1:{self.server_address[1]}/"
        self.image = image
        self.shown = 0
        """number of the newest snapshot; a page finds it in the snapshot as `shown`"""
        self.snapshot: snapshots.Snapshot = {}
        self.orders: list[tuple[str, Any]] = []
        self.previews = 0
        """number of preview streams that are open"""
        self.silent = False
        """True if event streams are to end, and new ones to be refused"""
        self.stop_fails = False
        self.slow_s = 0.0
        """time that each order takes [s]"""
        self.changed = threading.Condition()
        self.show(snapshots.base())

    def show(self, snapshot: snapshots.Snapshot) -> None:
        """Send a snapshot to all pages."""
        with self.changed:
            self.shown += 1
            self.snapshot = snapshot | {"shown": self.shown}
            self.changed.notify_all()

    def handle_error(self, *_: object) -> None:
        """Pages close their streams; nothing to report."""


class _Handler(http.server.BaseHTTPRequestHandler):
    server: SampleConsole

    def log_message(self, *_: object) -> None:
        pass

    def _send(self, status: int, kind: str, body: bytes) -> None:
        self.send_response(status)
        self._head(kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _head(self, kind: str) -> None:
        self.send_header("Content-Type", kind)
        self.send_header("Content-Security-Policy", CONTENT_POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Cache-Control", "no-store")

    def _json(self, content: Any, status: int = 200) -> None:
        self._send(status, "application/json", json.dumps(content).encode())

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        if path == "/":
            self._send(200, "text/html; charset=utf-8", (STATIC / "index.html").read_bytes())
        elif path.startswith("/static/") and ".." not in path and (STATIC / path[8:]).is_file():
            kind = TYPES[Path(path).suffix]
            self._send(200, f"{kind}; charset=utf-8", (STATIC / path[8:]).read_bytes())
        elif path == "/api/events":
            self._events()
        elif path == "/api/preview.mjpeg":
            self._preview()
        elif path.endswith("/curve"):
            self._json(results.curve())
        elif path == "/api/archive":
            self._json(results.archive())
        elif path == "/api/card.png":
            self._send(200, "image/png", (ROOT / "docs/images/card.png").read_bytes())
        else:
            self._json({"error": {"kind": "NotFound", "message": "not found", "remedy": ""}}, 404)

    def do_POST(self) -> None:
        content = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.server.orders.append((self.path, content))
        time.sleep(self.server.slow_s)
        if self.headers["X-Percuss"] != "1":
            self._json({"error": {"kind": "NoOrderHeader", "message": "no header", "remedy": ""}}, 403)
        elif self.path == "/api/stop" and self.server.stop_fails:
            self._json({"error": {"kind": "Silent", "message": "no answer", "remedy": ""}}, 504)
        elif self.path == "/api/invite":
            self._json({"url": f"{self.server.url}?token=sample"})
        else:
            self._json({"ok": True})

    def _events(self) -> None:
        if self.server.silent:
            self._json({}, 503)
            return
        self.send_response(200)
        self._head("text/event-stream")
        self.end_headers()
        sent = None
        while not self.server.silent:
            with self.server.changed:
                if sent is self.server.snapshot:
                    self.server.changed.wait(0.5)
                snapshot = self.server.snapshot
            text = ":\n\n" if sent is snapshot else f"event: state\ndata: {json.dumps(snapshot)}\n\n"
            sent = snapshot
            self.wfile.write(text.encode())
            self.wfile.flush()

    def _preview(self) -> None:
        self.send_response(200)
        self._head("multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        self.server.previews += 1
        try:
            while True:
                head = (
                    f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(self.server.image)}\r\n\r\n"
                )
                self.wfile.write(head.encode() + self.server.image + b"\r\n")
                time.sleep(0.2)
        finally:
            self.server.previews -= 1


@contextmanager
def sample_console() -> Iterator[SampleConsole]:
    """Console that serves during the `with` block."""
    with SampleConsole(camera_image()) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield server
        finally:
            server.silent = True
            server.shutdown()
