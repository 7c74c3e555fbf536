"""Decides what happens to each frame: a pre-trigger delay line, full rate inside a strike window, previews outside, meta always.

In continuous mode every frame goes straight to the file, and a window only says what of it belongs to a strike.

A frame enters the delay line and leaves it `pre_trigger_s` later, as meta alone or as a preview; a window that opens takes the
whole line with it. So images and meta reach the file in the order of their exposure, and `image_recorded` is always true to it.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from acquire.config import RecorderConfig
from acquire.errors import RecorderError
from acquire.recorder.image import RawImageEncoder, png_message
from acquire.recorder.ring import ImageRing
from acquire.recorder.writer import Channel, ImageMessage
from schemas import topics
from schemas.container import Buffer
from schemas.proto import percuss_pb2 as pb

BACKLOG_S: Final = 2.0
"""how long the disk may stand still before images are dropped"""
LATE_FRAME_S: Final = 0.25
"""how long a closing window waits for frames that were exposed before it closed"""
BATCH_BYTES: Final = 3 << 19
BATCH_S: Final = 0.02
"""Frames go to the file together, up to this size and no later than this: one wake-up, one chunk, one system call.

A buffered write of 1.3 MB takes a fifth less CPU per byte than one of 0.3 MB; above 2 MB ext4 (Linux 6.18) takes twice as much.
"""
FRAME_ID: Final = "camera"
"""Foxglove's name for C; the calibration carries the same"""


@dataclass(frozen=True)
class Arrival:
    """A frame with its times on the host's clock. `image` need only be valid during the call it is given to."""

    image: NDArray[np.uint8]
    """(height, width) mono8"""
    sequence: int
    frame_id: int
    device_time_ns: int
    host_time_ns: int
    mid_exposure_ns: int
    """host monotonic"""
    mapping_sd_ns: int
    exposure_us: float
    lost_before: int


@dataclass(frozen=True)
class WindowReport:
    """What a closed window holds; times are log times of its first and last image, of the window itself where there is none."""

    start_ns: int
    end_ns: int
    frames: int
    lost: int
    """frames that should be in the window and are not: lost on the way from the camera, or dropped before a slow disk"""


@dataclass(frozen=True)
class _Stored:
    meta: pb.FrameMeta
    slot: int | None


@dataclass
class _Window:
    start_ns: int
    """host monotonic"""
    end_ns: int | None = None
    first_ns: int = 0
    last_ns: int = 0
    frames: int = 0
    lost: int = 0


class ImageSink(Protocol):
    """Where messages go: one file, or a row of them."""

    def add_topic(self, topic: topics.Topic) -> Channel:
        """Make a channel."""
        ...

    def write(self, channel: Channel, log_time_ns: int, data: Buffer, sequence: int = 0) -> None:
        """Write one small message."""
        ...

    def write_images(self, channel: Channel, messages: Sequence[ImageMessage]) -> None:
        """Write images together."""
        ...

    def flush(self) -> None:
        """Hand small topics to the file now."""
        ...


class FrameRecorder:
    """Between the acquisition thread (`add`) and the file; its own thread writes. Windows are opened and closed from a third.

    Raises:
        RecorderError: from `open_window` and `close_window`, when the file can take no images.
    """

    def __init__(
        self, writer: ImageSink, camera: str, width: int, height: int, frame_rate_hz: float, config: RecorderConfig, wall_anchor_ns: int
    ) -> None:
        self.frames = 0
        self.lost = 0
        self.dropped = 0
        self.error: RecorderError | None = None
        self._writer = writer
        self._config = config
        self._continuous = config.mode == "continuous"
        self._anchor = wall_anchor_ns
        self._period_ns = 1e9 / frame_rate_hz
        self._pre_trigger_ns = int(config.pre_trigger_s * 1e9)
        self._preview_ns = 1e9 / config.preview_hz if config.preview_hz > 0 else math.inf
        self._next_preview_ns = 0.0 if config.preview_hz > 0 else math.inf
        self._ring = ImageRing(math.ceil(frame_rate_hz * (config.pre_trigger_s + BACKLOG_S)) + 2, height, width)
        self._raw = RawImageEncoder(FRAME_ID, width, height) if config.image_format == "raw" else None
        self._images = writer.add_topic(topics.raw_image(camera) if self._raw else topics.compressed_image(camera))
        self._metas = writer.add_topic(topics.frame_meta(camera))
        self._batch_frames = max(1, min(32, BATCH_BYTES // (width * height)))
        self._lock = threading.Lock()
        self._passed = threading.Condition(self._lock)
        """a frame went by, or the queue ran dry"""
        self._queued = threading.Condition(self._lock)
        self._line: deque[_Stored] = deque()
        """frames that may still become part of a window; in continuous mode they are in the file, or on their way, already"""
        self._queue: deque[tuple[_Stored, bool]] = deque()
        self._writing = False
        self._ending = False
        self._window: _Window | None = None
        self._newest_ns = 0
        self._thread = threading.Thread(target=self._write_queue, name="recorder-write")
        self._thread.start()

    def add(self, arrival: Arrival) -> None:
        """Take a frame in; its image is copied. Called from the acquisition thread; never waits for the disk."""
        slot = self._ring.take(arrival.image)
        if slot is None:
            slot = self._reclaim(arrival.image)
        stored = _Stored(_meta(arrival), slot)
        with self._lock:
            if self._ending:
                return
            self.frames += 1
            self.lost += arrival.lost_before
            self._newest_ns = mid = arrival.mid_exposure_ns
            window = self._window
            if window is not None and self._inside(window, mid):
                window.lost += arrival.lost_before if window.frames else 0
                self._count(window, stored)
                self._keep(stored)
            else:
                if self._continuous:
                    self._keep(stored)
                self._line.append(stored)
                self._age(mid - self._pre_trigger_ns)
            self._passed.notify_all()

    def open_window(self, now_ns: int) -> int:
        """From now on, and from `pre_trigger_s` before now (host monotonic), keep every image. Returns the start as a log time."""
        with self._lock:
            if self._window is not None:
                raise RecorderError("a window is open already: close it first")
            if self.error is not None:
                raise self.error
            self._window = window = _Window(start_ns=now_ns - self._pre_trigger_ns)
            self._age(window.start_ns)
            while self._line:
                stored = self._line.popleft()
                window.lost += stored.meta.frames_lost_before if window.frames else 0
                self._count(window, stored)
                if not self._continuous:
                    self._keep(stored)
            return self._anchor + window.start_ns

    def close_window(self, now_ns: int) -> WindowReport:
        """Keep what was exposed until now (host monotonic), wait until it is in the file, and say what it is."""
        with self._lock:
            window = self._window
            if window is None:
                raise RecorderError("no window is open")
            window.end_ns = now_ns
            self._passed.wait_for(lambda: self._newest_ns > now_ns, LATE_FRAME_S)
            self._window = None
            # A camera that fell silent owes the frames up to the window's end; no later frame will count them for this window.
            silent_ns = min(now_ns, window.start_ns + self._max_window_ns()) - max(self._newest_ns, window.start_ns)
            if self._newest_ns <= now_ns:
                window.lost += max(0, math.floor(silent_ns / self._period_ns - 0.5))
            self._passed.wait_for(lambda: not self._queue and not self._writing, 30.0)
            if self.error is not None:
                raise self.error
        self._writer.flush()
        first_ns, last_ns = (window.first_ns, window.last_ns) if window.frames else (window.start_ns, now_ns)
        return WindowReport(self._anchor + first_ns, self._anchor + last_ns, window.frames, window.lost)

    def close(self) -> None:
        """Write what waits, meta of the delay line included, and end the thread. Safe to call twice."""
        with self._lock:
            if not self._ending:
                self._ending = True
                self._age(self._newest_ns + 1)
                self._queued.notify_all()
        self._thread.join()

    # --- under the lock ---

    def _inside(self, window: _Window, mid_ns: int) -> bool:
        end = window.start_ns + self._max_window_ns() if window.end_ns is None else window.end_ns
        return mid_ns <= end

    def _max_window_ns(self) -> int:
        return int(self._config.max_window_s * 1e9) + self._pre_trigger_ns

    def _count(self, window: _Window, stored: _Stored) -> None:
        if stored.slot is None:
            window.lost += 1
        else:
            window.frames += 1
            window.last_ns = stored.meta.mid_exposure_host_ns
            window.first_ns = window.first_ns or window.last_ns

    def _keep(self, stored: _Stored) -> None:
        self.dropped += stored.slot is None
        self._enqueue(stored, image=stored.slot is not None)

    def _age(self, before_ns: int) -> None:
        """Let frames out of the delay line that were exposed before `before_ns`."""
        while self._line and self._line[0].meta.mid_exposure_host_ns < before_ns:
            stored = self._line.popleft()
            if self._continuous:
                continue
            mid = stored.meta.mid_exposure_host_ns
            preview = mid >= self._next_preview_ns and stored.slot is not None
            if preview:
                self._next_preview_ns = mid + self._preview_ns
            self._enqueue(stored, image=preview)

    def _enqueue(self, stored: _Stored, *, image: bool) -> None:
        if not image and stored.slot is not None:
            self._ring.give_back(stored.slot)
        self._queue.append((stored, image))
        if len(self._queue) == self._batch_frames:
            self._queued.notify()

    def _reclaim(self, image: NDArray[np.uint8]) -> int | None:
        """All slots wait for the disk: the oldest in the delay line gives up its image."""
        with self._lock:
            if not self._line or self._continuous:
                return None
            oldest = self._line.popleft()
            self._enqueue(oldest, image=False)
        return self._ring.take(image)

    # --- writing thread ---

    def _write_queue(self) -> None:
        while not self._ended():
            batch = self._next_batch()
            kept = [stored for stored, image in batch if image]
            try:
                if kept and self.error is None:
                    self._write_images(kept)
            except RecorderError as error:
                self.error = error
            if self.error is not None:
                self.dropped += len(kept)
            for stored, _ in batch:
                self._write_meta(stored)
            for stored in kept:
                if stored.slot is not None:
                    self._ring.give_back(stored.slot)

    def _ended(self) -> bool:
        with self._lock:
            self._writing = False
            if not self._queue:
                self._passed.notify_all()
            return self._ending and not self._queue

    def _next_batch(self) -> list[tuple[_Stored, bool]]:
        """Frames that are written together; none where none came for `BATCH_S`."""
        with self._lock:
            # At line rate a wake-up and a chunk for each frame would cost more than the frame: let a few gather.
            self._queued.wait_for(lambda: len(self._queue) >= self._batch_frames or self._ending, BATCH_S)
            self._writing = bool(self._queue)
            return [self._queue.popleft() for _ in range(min(len(self._queue), self._batch_frames))]

    def _write_images(self, kept: list[_Stored]) -> None:
        messages: list[ImageMessage] = []
        for stored in kept:
            if stored.slot is not None:
                log_time = self._anchor + stored.meta.mid_exposure_host_ns
                image = self._ring.image(stored.slot)
                data: list[Buffer] = self._raw.encode(log_time, image) if self._raw else [png_message(FRAME_ID, log_time, image)]
                messages.append(ImageMessage(log_time, data, stored.meta.sequence))
        self._writer.write_images(self._images, messages)
        for stored in kept:
            stored.meta.image_recorded = True

    def _write_meta(self, stored: _Stored) -> None:
        log_time = self._anchor + stored.meta.mid_exposure_host_ns
        try:
            self._writer.write(self._metas, log_time, stored.meta.SerializeToString(), sequence=stored.meta.sequence)
        except RecorderError as error:
            self.error = error


def _meta(arrival: Arrival) -> pb.FrameMeta:
    height, width = arrival.image.shape
    return pb.FrameMeta(
        sequence=arrival.sequence,
        device_time_ns=arrival.device_time_ns,
        host_time_ns=arrival.host_time_ns,
        mid_exposure_host_ns=arrival.mid_exposure_ns,
        exposure_us=arrival.exposure_us,
        frame_id=arrival.frame_id,
        frames_lost_before=arrival.lost_before,
        width=width,
        height=height,
        mapping_sd_ns=arrival.mapping_sd_ns,
    )
