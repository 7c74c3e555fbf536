"""Answers that go on: server-sent events with the state, and live images as MJPEG."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from typing import Final

from starlette.concurrency import run_in_threadpool
from starlette.responses import StreamingResponse

from acquire.console.web.backend import Backend, Viewer
from acquire.console.web.refusal import Refusal
from acquire.console.web.visitors import Visitor, Visitors

STATE_S: Final = 0.1
"""shortest interval between two states [s]"""
HEARTBEAT_S: Final = 1.0
"""interval between comment lines that show that the console is alive [s]"""
IMAGE_S: Final = 0.1
"""shortest interval between two live images [s]"""
MAX_STREAMS: Final = 8
"""event streams that one browser may have open"""
BOUNDARY: Final = "percussframe"


def events(
    backend: Backend,
    visitors: Visitors,
    visitor: Visitor,
    viewer: Callable[[Visitor], Viewer],
    ended: Callable[[], bool],
) -> StreamingResponse:
    """Stream of server-sent events: the state whenever it has changed, and a heartbeat.

    Args:
        backend: the rig.
        visitors: register of browsers.
        visitor: browser that listens.
        viewer: function that returns a browser's role.
        ended: function that returns True when the console ends.

    Raises:
        Refusal: the browser has too many streams open.
    """
    if visitor.streams >= MAX_STREAMS:
        raise Refusal(429, "TooMany", f"this browser has {MAX_STREAMS} event streams open", "close some tabs")

    async def lines() -> AsyncIterator[str]:
        visitors.open_stream(visitor)
        try:
            yield "retry: 1000\n\n"
            shown, beat_s = None, time.monotonic()
            while not ended():
                snapshot = backend.snapshot(viewer(visitor))
                if (compared := snapshot.model_copy(update={"time_ns": 0})) != shown:
                    shown = compared
                    yield f"event: state\ndata: {snapshot.model_dump_json()}\n\n"
                if time.monotonic() - beat_s >= HEARTBEAT_S:
                    beat_s = time.monotonic()
                    yield ": alive\n\n"
                await asyncio.sleep(STATE_S)
        finally:
            visitors.close_stream(visitor)

    return StreamingResponse(lines(), media_type="text/event-stream", headers={"x-accel-buffering": "no"})


def preview(backend: Backend, ended: Callable[[], bool]) -> StreamingResponse:
    """Stream of live images; it ends when the browser closes it.

    Args:
        backend: the rig.
        ended: function that returns True when the console ends.
    """

    async def parts() -> AsyncIterator[bytes]:
        shown = -1
        while not ended():
            began_s = time.monotonic()
            image = await run_in_threadpool(backend.preview)
            if image is not None and image[0] != shown:
                shown, data = image
                head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                yield head.encode() + data + b"\r\n"
            await asyncio.sleep(max(0.01, IMAGE_S - (time.monotonic() - began_s)))

    return StreamingResponse(parts(), media_type=f"multipart/x-mixed-replace; boundary={BOUNDARY}")
