"""`analyze watch`: follow a growing recording, report what is in view, and judge strikes.

Requests, events and verdicts are JSON lines (schemas/watch_lines.py). The process runs as a child of the
daemon on a core that it shares with the capture: it is single-threaded apart from reading its input, and
decodes at most twelve images a second, except for a verdict. Images of the last seconds are kept as
references into the file, not decoded, until a strike is judged.
"""

from __future__ import annotations

import json
import queue
import threading
import time
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Protocol, cast

import cv2

from analyze.pipeline.object_markers import placed_markers
from analyze.pipeline.sections import MeshSections
from analyze.reading.followed_series import FollowedSeries
from analyze.tracking.camera_model import camera_from_spec
from analyze.verbs.watch.observer import Observer, unreadable
from analyze.verbs.watch.tosses import TossJudge, unreadable_toss
from schemas import topics
from schemas.document import DocumentError, canonical_json, validate
from schemas.watch_lines import JudgeRequest, StrikeVerdict, TossJudgement, TossRequest, WatchEvent

if TYPE_CHECKING:
    from pathlib import Path
    from typing import TextIO

    from analyze.reading.indexed_file import RecordedMessage

FRESH_NS = 1_000_000_000
"""largest age [ns], relative to the newest image, of an image that is evaluated.

A watcher that starts late or lags skips older ones.
"""
POLL_INTERVAL_S = 0.04
MAX_WAIT_FOR_IMAGES_S = 3.0
"""time after which a strike is judged even if the end of its window is not in the file [s]"""
_NO_IMAGES = "the recording contains no images yet: is the capture running?"


class WatchClock(Protocol):
    """Protocol of the clock that `watch_recording` uses: the module `time`, or a simulated clock."""

    def monotonic(self) -> float:
        """Time [s] since an arbitrary start, never decreasing."""
        ...

    def sleep(self, seconds: float, /) -> None:
        """Wait for `seconds` [s]."""
        ...


def _read_lines(stream: TextIO, lines: queue.SimpleQueue[str | None]) -> None:
    with suppress(OSError, ValueError):  # the stream was closed, which ends it as well
        for line in stream:
            lines.put(line)
    lines.put(None)


def watch_recording(path: Path, stdin: TextIO, stdout: TextIO, clock: WatchClock = time) -> None:
    """Follow a recording, and the files that continue it, until `stdin` ends or `stdout` is closed.

    An image that is more than a second older than the newest one read with it is not evaluated, so that a
    late start does not delay the events. It is kept for verdicts.

    Args:
        path: the growing recording; it may not exist yet.
        stdin: JudgeRequest lines, each a request for a verdict or the planned strike to expect, and
            TossRequest lines; others are ignored.
        stdout: WatchEvent lines (markers in view, rest, placement) StrikeVerdict and TossJudgement lines.
        clock: for pauses and timeouts; the machine's by default.

    Raises:
        RecordingError: the file is no recording or is damaged, or did not appear while `stdin` was open.
    """
    cv2.setNumThreads(1)
    lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    reader = threading.Thread(target=_read_lines, args=(stdin, lines), name="watch-stdin", daemon=True)
    reader.start()
    recording = FollowedSeries(path)
    try:
        _Watcher(recording, lines, stdout, clock).run()
    finally:
        recording.close()


def _request(data: object) -> JudgeRequest | TossRequest:
    """Request by a line's JSON.

    Raises:
        DocumentError: it is none.
    """
    tossed = isinstance(data, dict) and cast("dict[str, object]", data).get("kind") == "judge_toss"
    return validate(TossRequest if tossed else JudgeRequest, data, "standard input")


class _ReaderGoneError(Exception):
    """Raised when the reader of the output has closed it."""


class _Watcher:
    """Main loop of `analyze watch`: follows one recording, writes events and answers requests.

    Args:
        recording: the growing recording.
        lines: queue of the request lines; None at the end of the input.
        stdout: stream for the events and verdicts, one JSON line each.
        clock: clock for pauses and timeouts.
    """

    def __init__(
        self,
        recording: FollowedSeries,
        lines: queue.SimpleQueue[str | None],
        stdout: TextIO,
        clock: WatchClock,
    ) -> None:
        self._recording = recording
        self._lines = lines
        self._stdout = stdout
        self._clock = clock
        self._observer: Observer | None = None
        self._image_topic = ""
        self._expected_strike = ""
        self._tosses: TossJudge | None = None
        self._pending: deque[tuple[float, JudgeRequest | TossRequest]] = deque()
        """requests with the time until which they may wait for images"""

    def run(self) -> None:
        """Follow the growing recording and judge strikes on request, until the input or output is closed.

        Requests are lines of the input. At its end, all pending requests are judged first.

        Raises:
            RecordingError: the file is no recording or is damaged, or has not appeared by the input's end.
        """
        try:
            while True:
                ended = self._take_requests()
                messages = self._recording.poll()
                if self._observer is None:
                    self._observer = self._make_observer()
                self._observe([message for message in messages if message.topic == self._image_topic])
                self._judge(ended)
                if ended:
                    self._recording.refuse_missing()
                    return
                self._clock.sleep(POLL_INTERVAL_S)
        except _ReaderGoneError:
            return

    def _take_requests(self) -> bool:
        """Take the request lines that have arrived on standard input, without waiting.

        A line names the strike that is expected next, or asks for the verdict on a strike; the latter is
        queued, to be answered once the images are there. Lines that are not requests are ignored.

        Returns:
            True if no more lines will come.
        """
        while not self._lines.empty():
            line = self._lines.get()
            if line is None:
                return True
            try:
                request = _request(json.loads(line))
            except (DocumentError, ValueError, RecursionError):
                continue  # not a request
            if isinstance(request, JudgeRequest) and request.kind == "expect":
                self._expected_strike = request.plan_strike_id
                if self._observer is not None:
                    self._observer.expect(self._expected_strike)
            else:
                self._pending.append((self._clock.monotonic() + MAX_WAIT_FOR_IMAGES_S, request))
        return False

    def _make_observer(self) -> Observer | None:
        """Make the observer of this recording's images, and note the topic of the images.

        Returns:
            The observer, which expects the strike that was last requested. None until the recording's
            manifest (description of the session) and plan have been read.
        """
        recording = self._recording
        if recording.manifest is None or (plan := recording.plan) is None:
            return None
        camera = recording.manifest.cameras[0]
        self._image_topic = topics.raw_image(camera.name).name
        spec = recording.manifest.object
        sections = MeshSections(spec, lambda: recording.shape_bytes)
        lens = camera_from_spec(camera.calibration)
        markers = placed_markers(spec)
        observer = Observer(lens, markers, plan, recording.image, sections)
        self._tosses = TossJudge(
            recording.manifest, lens, markers, lambda: recording.shape_bytes, observer.rest_views
        )
        observer.expect(self._expected_strike)
        return observer

    def _observe(self, images: list[RecordedMessage]) -> None:
        if self._observer is None or not images:
            return
        fresh_ns = images[-1].log_time_ns - FRESH_NS
        for image in images:
            if image.log_time_ns < fresh_ns:
                self._observer.keep(image)
            elif (event := self._observer.add(image)) is not None:
                self._write(event)

    def _judge(self, ended: bool) -> None:
        """Write the verdicts of pending requests, in the order of the requests.

        A request waits until the images of its time window are in the file, at most `MAX_WAIT_FOR_IMAGES_S`;
        requests behind it wait too. If `ended` is True, all are judged at once from the images read so far.
        """
        observer = self._observer
        while self._pending:
            deadline, request = self._pending[0]
            complete = observer is not None and observer.newest_ns >= request.window_end_ns
            if not complete and not ended and self._clock.monotonic() < deadline:
                break
            self._pending.popleft()
            self._write(self._verdict(observer, request))

    def _verdict(
        self, observer: Observer | None, request: JudgeRequest | TossRequest
    ) -> StrikeVerdict | TossJudgement:
        if isinstance(request, JudgeRequest):
            return unreadable(request, _NO_IMAGES) if observer is None else observer.judge(request)
        if observer is None or self._tosses is None:
            return unreadable_toss(request, _NO_IMAGES)
        frames = observer.frames(request.window_start_ns, request.window_end_ns)
        return self._tosses.judge(request, frames)

    def _write(self, document: WatchEvent | StrikeVerdict | TossJudgement) -> None:
        try:
            self._stdout.write(canonical_json(document) + "\n")
            self._stdout.flush()
        except (OSError, ValueError):
            raise _ReaderGoneError from None
