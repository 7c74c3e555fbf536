"""`analyze advise`: follow a recording that is being written, and answer requests for advice.

Requests and answers are JSON lines (schemas/watch_lines.py). The process runs as a child of the daemon, apart
from capture and verdicts: if it ends, the session goes on by its plan.
"""

from __future__ import annotations

import json
import queue
import sys
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING

import cv2

from analyze.errors import AnalyzeError
from analyze.reading.live_recording import LiveRecording
from analyze.verbs.advise.adviser import Adviser
from schemas.document import DocumentError, canonical_json, validate
from schemas.watch_lines import AdviceRequest

if TYPE_CHECKING:
    from pathlib import Path
    from typing import TextIO

POLL_INTERVAL_S = 0.05
MAX_WAIT_FOR_RECORD_S = 3.0
"""longest wait for the record of the newest strike [s], after which the answer is given without it"""


def advise_session(path: Path, stdin: TextIO, stdout: TextIO) -> None:
    """Follow a recording, and the files that continue it, until `stdin` ends or `stdout` is closed.

    Args:
        path: the growing recording; it may not exist yet.
        stdin: AdviceRequest lines; others are ignored.
        stdout: one SessionEstimate line for each request; none for one that cannot be answered, with the
            reason on standard error.

    Raises:
        RecordingError: the file is no recording or is damaged.
        PlanError, ShapeError: object or plan in it cannot be used.
    """
    cv2.setNumThreads(1)
    lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    threading.Thread(target=_read_lines, args=(stdin, lines), name="advise-stdin", daemon=True).start()
    with LiveRecording(path, retention_ns=None) as live:
        adviser: Adviser | None = None
        while (line := _next_line(lines)) is not None:
            request = _request(line)
            if adviser is None and _is_ready(live):
                adviser = Adviser(live)
            if adviser is not None:
                adviser.read_new()
            if request is None:
                continue
            adviser = adviser or _awaited(live)
            if adviser is None or not _write(stdout, adviser, request):
                return


def _is_ready(live: LiveRecording) -> bool:
    """True if manifest and plan have been read, after a look at what was written meanwhile."""
    if not live.ready:
        live.poll()
    return live.ready


def _awaited(live: LiveRecording) -> Adviser | None:
    """Adviser of a recording whose manifest and plan are about to be written; None if they do not come."""
    until = time.monotonic() + MAX_WAIT_FOR_RECORD_S
    while not _is_ready(live):
        if time.monotonic() > until:
            return None
        time.sleep(POLL_INTERVAL_S)
    return Adviser(live)


def _write(stdout: TextIO, adviser: Adviser, request: AdviceRequest) -> bool:
    """Write the answer to a request; False if nobody reads it any more."""
    until = time.monotonic() + MAX_WAIT_FOR_RECORD_S
    while adviser.newest != request.strike_id and time.monotonic() < until:
        time.sleep(POLL_INTERVAL_S)
        adviser.read_new()
    try:
        text = canonical_json(adviser.answer(request))
    except AnalyzeError as error:
        sys.stderr.write(f"analyze advise: {error}\n")
        return True
    try:
        stdout.write(text + "\n")
        stdout.flush()
    except (OSError, ValueError):
        return False
    return True


def _request(line: str) -> AdviceRequest | None:
    """Request in a line; None if it holds none."""
    if not line:
        return None
    try:
        return validate(AdviceRequest, json.loads(line), "standard input")
    except (DocumentError, ValueError, RecursionError):
        return None


def _next_line(lines: queue.SimpleQueue[str | None]) -> str | None:
    """Next line of the input; "" if none arrived within `POLL_INTERVAL_S`, None at the input's end."""
    try:
        return lines.get(timeout=POLL_INTERVAL_S)
    except queue.Empty:
        return ""


def _read_lines(stream: TextIO, lines: queue.SimpleQueue[str | None]) -> None:
    with suppress(OSError, ValueError):  # the stream was closed, which ends it as well
        for line in stream:
            lines.put(line)
    lines.put(None)
