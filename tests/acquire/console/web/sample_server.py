"""Serve the console's pages with made-up snapshots: `python -m tests.acquire.console.web.sample_server`.

It prints an address with a token. The state is chosen by POST /api/sample {"state": "placing"}, by
`--state placing`, or by the page's address: /?sample=placing. `--list` prints all states (samples.py). Orders
are answered but change nothing, except stop (state "stopped") and stop/clear (state "ready").
`--open` lets every browser of this computer in without a token, for screenshots only.
"""

from __future__ import annotations

import argparse
import io
import math
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from acquire.console.web.app import make_app
from acquire.console.web.backend import Viewer
from acquire.console.web.gate import cookie_name
from acquire.console.web.orders import Answer, ArchiveEntry, Curve, StartSession, StopDone
from acquire.console.web.refusal import Refusal
from acquire.console.web.routes import Site
from acquire.console.web.server import WebServer, ended_by_signals, listen
from acquire.console.web.snapshot import Snapshot
from acquire.console.web.visitors import Visitors
from tests.acquire.console.web.samples import STATES, estimate, sample

CARD = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 200 140">
<path d="M20 120h160" stroke="#888"/>
<path d="M60 120V30h80v90z" fill="#dde" stroke="#335"/>
<text x="70" y="80" font-size="14">tag 3</text></svg>"""


class SampleBackend:
    """Rig that shows one made-up state, and carries out nothing."""

    def __init__(self, state: str = "ready") -> None:
        self.state = state
        self.orders: list[Any] = []
        self._image = _picture()

    def snapshot(self, viewer: Viewer) -> Snapshot:
        return sample(self.state, viewer)

    def stop(self) -> StopDone:
        self.orders.append("stop")
        self.state = "stopped"
        return StopDone(state="disarmed", was="homed", latency_ms=7.4)

    def clear_stop(self) -> None:
        self.orders.append("clear")
        self.state = "ready"

    def start_daemon(self) -> None:
        self.orders.append("daemon")

    def start_check(self) -> None:
        self.orders.append("check")

    def start_session(self, order: StartSession) -> None:
        self.orders.append(order)

    def pause(self, when: str) -> None:
        self.orders.append(when)

    def resume(self) -> None:
        self.orders.append("resume")

    def abort(self) -> None:
        self.orders.append("abort")

    def answer(self, answer: Answer) -> None:
        self.orders.append(answer)

    def card(self, strike_id: str) -> bytes:
        return CARD.encode()

    def curve(self, strike_id: str) -> Curve:
        times = [0.012 * i for i in range(80)]
        angles = [21.4 * (1 - math.cos(2.4 * t)) + 0.1 * math.sin(40 * t) for t in times]
        return Curve(
            time_s=times,
            theta_deg=angles,
            fit_time_s=times[5:70],
            fit_deg=[21.4 * (1 - math.cos(2.4 * t)) for t in times[5:70]],
            phi_deg=24.5,
            window_s=[times[5], times[69]],
        )

    def preview(self) -> tuple[int, bytes]:
        return int(10 * time.monotonic()), self._image

    def archive(self) -> list[ArchiveEntry]:
        return [
            ArchiveEntry(
                id=f"r{i}",
                file=f"carton-{i}.mcap",
                object=("carton", "spray <b>can</b> & cap")[i % 2],
                date=f"2026-11-{i + 10}T09:30:00Z",
                strikes=None if i == 3 else 9,
                com_mm=None if i == 3 else [31.2, 41.8 + 0.1 * i, 65.5],
                com_sd_mm=None if i == 3 else [0.3, 0.5, 0.4],
                flags=["not finished"] if i == 3 else ["checks failed"] if i == 2 else [],
                earlier_strikes=3 if i == 1 else 0,
                size_bytes=1_100_000_000 - 90_000_000 * i,
                complete=i != 3,
            )
            for i in range(1, 9)
        ]

    def estimate(self, recording_id: str) -> dict[str, Any]:
        return estimate(7)

    def report(self, recording_id: str) -> Path:
        raise Refusal(404, "Unknown", "the sample server has no reports")

    def recording(self, recording_id: str) -> Path:
        raise Refusal(404, "Unknown", "the sample server has no recordings")


def _picture() -> bytes:
    """JPEG of a box on a table with a tag."""
    grey = np.tile(np.linspace(70, 120, 492, dtype=np.uint8)[:, None], (1, 656))
    image = Image.fromarray(grey)
    draw = ImageDraw.Draw(image)
    draw.rectangle((0, 405, 656, 492), fill=150)
    draw.polygon([(226, 404), (222, 190), (404, 184), (412, 400)], fill=190)
    draw.rectangle((280, 250, 345, 315), fill=20)
    draw.rectangle((296, 266, 312, 298), fill=230)
    data = io.BytesIO()
    image.save(data, "JPEG", quality=80)
    return data.getvalue()


class SampleSwitch:
    """ASGI application before the console's: chooses the state, and lets everybody in with `--open`."""

    def __init__(self, app: Any, backend: SampleBackend, secret: str | None, port: int) -> None:
        self._app, self._backend, self._secret, self._port = app, backend, secret, port

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        query = scope.get("query_string", b"").decode()
        if query.startswith("sample=") and query[7:] in STATES:
            self._backend.state = query[7:]
        if self._secret is not None and scope["type"] == "http":
            cookie = f"{cookie_name(self._port)}={self._secret}".encode()
            scope["headers"] = [h for h in scope["headers"] if h[0] != b"cookie"] + [(b"cookie", cookie)]
        if scope["type"] == "http" and scope["path"] == "/api/sample":
            body = (await receive()).get("body", b"").decode()
            found = [state for state in STATES if f'"{state}"' in body]
            self._backend.state = found[0] if found else self._backend.state
            await send({"type": "http.response.start", "status": 204, "headers": []})
            await send({"type": "http.response.body"})
            return
        await self._app(scope, receive, send)


def main() -> None:
    """Serve until Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=8770)
    parser.add_argument("--state", choices=STATES, default="ready")
    parser.add_argument("--open", action="store_true", help="let every browser in without a token")
    parser.add_argument("--list", action="store_true", help="print the states")
    given = parser.parse_args()
    if given.list:
        sys.stdout.write("\n".join(STATES) + "\n")
        return
    listener = listen(given.port)
    port = listener.getsockname()[1]
    visitors, backend = Visitors(), SampleBackend(given.state)
    site = Site(backend, visitors, f"http://127.0.0.1:{port}")
    secret = visitors.add() if given.open else None
    server = WebServer(SampleSwitch(make_app(site, port), backend, secret, port), listener, site.ended)
    sys.stdout.write(f"{site.address}/?token={visitors.new_token()}\n")
    sys.stdout.flush()
    with ended_by_signals(server.end):
        thread = threading.Thread(target=server.run)
        thread.start()
        while thread.is_alive():
            thread.join(0.2)


if __name__ == "__main__":
    main()
