"""Decides what happens to each frame: a pre-trigger delay line, full rate inside a strike window, previews outside, meta always.

In continuous mode every frame goes straight to the file, and a window only says what of it belongs to a strike.

A frame enters the delay line and leaves it `pre_trigger_s` later; a window that opens takes the whole line with it. Its meta, and a
preview, do not wait longer than META_WAIT_S: a killed process must not have kept back more. So images and meta reach the file in the
order of their exposure, and `image_recorded` is always true to it, where `pre_trigger_s` is no longer than that. Where it is longer, the
images that a window takes from the line come behind newer metas, which said that they are not recorded.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from acquire.config import RecorderConfig
from acquire.errors import RecorderError
from acquire.recorder.direct.block_memory import BLOCK_BYTES, BlockMemory
from acquire.recorder.direct.borrowed_queue import Lender, LentQueue
from acquire.recorder.frame_queue import AtOnce, FrameFile, FrameQueue, ImageSink, Queued
from acquire.recorder.page_memory import PAGE
from schemas.proto import percuss_pb2 as pb

BACKLOG_S: Final = 2.0
"""how long the disk may stand still before images are dropped"""
META_WAIT_S: Final = 0.25
"""how long a frame's meta may wait for a trigger"""
LATE_FRAME_S: Final = 0.25
"""how long a closing window waits for frames that were exposed before it closed"""


def backlog_bytes(width: int, height: int, frame_rate_hz: float) -> int:
    """Memory for a recording that is written past the page cache."""
    return math.ceil(BACKLOG_S * frame_rate_hz * width * height) + 4 * BLOCK_BYTES


def backlog_frames(width: int, height: int, frame_rate_hz: float) -> int:
    """How many of its frames a camera lends to such a recording: the same memory. None where they are smaller than a page."""
    return math.ceil(BACKLOG_S * frame_rate_hz) if width * height >= PAGE else 0


def lent_memory(width: int, height: int, frames: int) -> BlockMemory:
    """Memory for what is not lent, where a camera lends so many frames."""
    # Of each image the end and what stands between it and the next, two pages at most; a file that ends beside the next one's head.
    return BlockMemory(frames * 2 * PAGE + 8 * BLOCK_BYTES, frames * width * height)


class Arrival(NamedTuple):
    """A frame with its times on the host's clock. `image` need only be valid during the call it is given to, unless it is kept."""

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
    lender: Lender | None = None
    """whose memory the image lies in; None: it must be copied"""


@dataclass(frozen=True)
class WindowReport:
    """What a closed window holds; times are log times of its first and last image, of the window itself where there is none."""

    start_ns: int
    end_ns: int
    frames: int
    lost: int
    """frames that should be in the window and are not: lost on the way from the camera, or dropped before a slow disk"""


@dataclass(slots=True)
class _Stored:
    meta: pb.FrameMeta
    mid_ns: int
    """host monotonic"""
    image: bool
    """it is in the file, on its way there, or can still be written"""
    slot: int | None
    """of the image in the ring, while it is ours"""


@dataclass
class _Window:
    start_ns: int
    """host monotonic"""
    end_ns: int | None = None
    first_ns: int = 0
    last_ns: int = 0
    frames: int = 0
    lost: int = 0


class FrameRecorder:
    """Between the acquisition thread (`add`) and the file. Windows are opened and closed from another thread.

    Raises:
        RecorderError: from `open_window` and `close_window`, when the file can take no images.
    """

    def __init__(
        self,
        writer: ImageSink,
        camera: str,
        width: int,
        height: int,
        frame_rate_hz: float,
        config: RecorderConfig,
        wall_anchor_ns: int,
        *,
        lent: bool = False,
    ) -> None:
        """`lent`: arrivals have lenders, whose buffers are used where the mode allows it."""
        self.frames = 0
        self.lost = 0
        self._config = config
        self._continuous = config.mode == "continuous"
        self._anchor = wall_anchor_ns
        self._period_ns = 1e9 / frame_rate_hz
        self._pre_trigger_ns = int(config.pre_trigger_s * 1e9)
        self._meta_wait_ns = min(self._pre_trigger_ns, int(META_WAIT_S * 1e9))
        self._preview_ns = 1e9 / config.preview_hz if config.preview_hz > 0 else math.inf
        self._next_preview_ns = 0.0 if config.preview_hz > 0 else math.inf
        self._every_meta = pb.FrameMeta(width=width, height=height)
        raw = config.image_format == "raw"
        self._file = FrameFile(writer, camera, (width, height) if raw else None, wall_anchor_ns)
        # PNG takes longer than a frame may: the thread of the queue does it.
        self._way: AtOnce | LentQueue | FrameQueue
        if self._continuous and raw and writer.never_waits:
            self._way = LentQueue(self._file) if lent else AtOnce(self._file)
        else:
            self._way = FrameQueue(self._file, math.ceil(frame_rate_hz * (config.pre_trigger_s + BACKLOG_S)) + 2, height, width)
        self._queue = self._way if isinstance(self._way, FrameQueue) else None
        self._dropped = 0
        self._lock = threading.Lock()
        self._passed = threading.Condition(self._lock)
        """a frame went by"""
        self._awaited = False
        """somebody waits for one"""
        self._line: deque[_Stored] = deque()
        """frames that may still become part of a window; in continuous mode they are in the file, or on their way, already"""
        self._told = 0
        """of the line, how many of the oldest have their meta in the file, or on its way"""
        self._ending = False
        self._window: _Window | None = None
        self._newest_ns = 0

    @property
    def dropped(self) -> int:
        """Images that should be in the file and are not, because the disk was too slow or full."""
        return self._dropped + self._way.dropped

    @property
    def waiting(self) -> int:
        """Frames in the queue before the disk; see BlockMemory for what is with the file."""
        return 0 if isinstance(self._way, AtOnce) else self._way.waiting

    @property
    def error(self) -> RecorderError | None:
        """Why the file takes no more images."""
        return self._way.error

    def add(self, arrival: Arrival) -> None:
        """Take a frame in; its image is copied, or kept. Called from the acquisition thread; never waits for the disk."""
        if self._ending:
            return
        meta = self._meta(arrival)
        stored = self._take(meta, arrival)
        with self._lock:
            self.frames += 1
            self.lost += arrival.lost_before
            self._newest_ns = mid = arrival.mid_exposure_ns
            window, line = self._window, self._line
            if window is not None and self._inside(window, mid):
                window.lost += arrival.lost_before if window.frames else 0
                self._count(window, stored)
                self._keep(stored)
            elif self._continuous:
                self._keep(stored)
                line.append(stored)
                while line[0].mid_ns < mid - self._pre_trigger_ns:
                    line.popleft()
                self._told = len(line)
            else:
                line.append(stored)
                self._tell(mid - self._meta_wait_ns)
                self._let_go(mid - self._pre_trigger_ns)
            if self._awaited:
                self._passed.notify_all()

    def open_window(self, now_ns: int) -> int:
        """From now on, and from `pre_trigger_s` before now (host monotonic), keep every image. Returns the start as a log time."""
        with self._lock:
            if self._window is not None:
                raise RecorderError("a window is open already: close it first")
            if self.error is not None:
                raise self.error
            self._window = window = _Window(start_ns=now_ns - self._pre_trigger_ns)
            self._let_go(window.start_ns)
            for stored in self._line:
                window.lost += stored.meta.frames_lost_before if window.frames else 0
                self._count(window, stored)
                told, self._told = self._told > 0, max(0, self._told - 1)
                if not told:
                    self._keep(stored)
                elif stored.slot is not None:
                    self._put(stored, with_meta=False)
            self._line.clear()
            return self._anchor + window.start_ns

    def close_window(self, now_ns: int, end_ns: int = 0) -> WindowReport:
        """Keep what was exposed until now (host monotonic), wait until it is in the file, and say what it is.

        Args:
            now_ns: host monotonic.
            end_ns: log time; where it is before now the window need not last longer. 0: until now.
        """
        now_ns = min(now_ns, end_ns - self._anchor) if end_ns else now_ns
        with self._lock:
            window = self._window
            if window is None:
                raise RecorderError("no window is open")
            window.end_ns = now_ns
            self._awaited = True
            self._passed.wait_for(lambda: self._newest_ns > now_ns, LATE_FRAME_S)
            self._awaited = False
            self._window = None
            # A camera that fell silent owes the frames up to the window's end; no later frame will count them for this window.
            silent_ns = min(now_ns, window.start_ns + self._max_window_ns()) - max(self._newest_ns, window.start_ns)
            if self._newest_ns <= now_ns:
                window.lost += max(0, math.floor(silent_ns / self._period_ns - 0.5))
        if not isinstance(self._way, AtOnce):
            self._way.wait_until_written(30.0)
        if self.error is not None:
            raise self.error
        self._file.flush()
        first_ns, last_ns = (window.first_ns, window.last_ns) if window.frames else (window.start_ns, now_ns)
        return WindowReport(self._anchor + first_ns, self._anchor + last_ns, window.frames, window.lost)

    def close(self) -> None:
        """Write what waits, meta of the delay line included. Safe to call twice."""
        with self._lock:
            if not self._ending:
                self._ending = True
                self._tell(self._newest_ns + 1)
        if not isinstance(self._way, AtOnce):
            self._way.close()

    def _take(self, meta: pb.FrameMeta, arrival: Arrival) -> _Stored:
        image = arrival.image
        if isinstance(self._way, LentQueue):
            return _Stored(meta, arrival.mid_exposure_ns, self._way.take(meta, arrival.mid_exposure_ns, arrival.lender), None)
        if isinstance(self._way, AtOnce):
            return _Stored(meta, arrival.mid_exposure_ns, self._way.write(meta, image), None)
        slot = self._way.ring.take(image)
        if slot is None and not self._continuous:
            self._reclaim()
            slot = self._way.ring.take(image)
        return _Stored(meta, arrival.mid_exposure_ns, slot is not None, slot)

    def _reclaim(self) -> None:
        """All slots wait for the disk: the oldest in the delay line gives up its image."""
        with self._lock:
            while self._line and self._line[0].slot is None:
                self._let_go(self._line[0].mid_ns + 1)
            if self._line:
                self._line[0].image = False
                self._let_go(self._line[0].mid_ns + 1)

    def _meta(self, arrival: Arrival) -> pb.FrameMeta:
        meta = pb.FrameMeta()
        meta.CopyFrom(self._every_meta)  # half as long as naming every field
        meta.sequence = arrival.sequence
        meta.device_time_ns = arrival.device_time_ns
        meta.host_time_ns = arrival.host_time_ns
        meta.mid_exposure_host_ns = arrival.mid_exposure_ns
        meta.frame_id = arrival.frame_id
        meta.mapping_sd_ns = arrival.mapping_sd_ns
        meta.exposure_us = arrival.exposure_us
        if arrival.lost_before:
            meta.frames_lost_before = arrival.lost_before
        return meta

    # --- under the lock ---

    def _inside(self, window: _Window, mid_ns: int) -> bool:
        end = window.start_ns + self._max_window_ns() if window.end_ns is None else window.end_ns
        return mid_ns <= end

    def _max_window_ns(self) -> int:
        return int(self._config.max_window_s * 1e9) + self._pre_trigger_ns

    def _count(self, window: _Window, stored: _Stored) -> None:
        if stored.image:
            window.frames += 1
            window.last_ns = stored.mid_ns
            window.first_ns = window.first_ns or window.last_ns
        else:
            window.lost += 1

    def _keep(self, stored: _Stored) -> None:
        if self._queue is not None:
            self._dropped += not stored.image
            self._put(stored)

    def _put(self, stored: _Stored, *, with_meta: bool = True) -> None:
        """Hand the frame over, its slot with it."""
        if self._queue is not None:
            self._queue.put(Queued(stored.meta, stored.slot, with_meta))
            stored.slot = None

    def _tell(self, before_ns: int) -> None:
        """Write the meta of frames in the line that were exposed before `before_ns`, and what of them is due as a preview."""
        while self._told < len(self._line) and (stored := self._line[self._told]).mid_ns < before_ns:
            mid = stored.mid_ns
            self._told += 1
            if mid >= self._next_preview_ns and stored.image:
                self._next_preview_ns = mid + self._preview_ns
                self._put(stored)
            elif self._queue is not None:
                self._queue.put(Queued(stored.meta, None))

    def _let_go(self, before_ns: int) -> None:
        """Let frames out of the delay line that were exposed before `before_ns`."""
        self._tell(before_ns)
        while self._line and self._line[0].mid_ns < before_ns:
            stored = self._line.popleft()
            self._told -= 1
            if stored.slot is not None and self._queue is not None:
                self._queue.ring.give_back(stored.slot)
