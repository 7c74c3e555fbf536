"""Recorder of strike windows: full rate inside and shortly before a window, previews between windows.

A preview is a single image, recorded at most `preview_hz` times per second. The metadata of every frame are
recorded.

A frame enters a delay line (queue of recent frames) and leaves it `pre_trigger_s` later. A window that opens
takes the frames in the line. A frame's meta (FrameMeta message: times, losses), and a preview, wait at most
META_WAIT_S (0.25 s), so that a killed process loses no more. If `pre_trigger_s` is not longer than that,
images and meta reach the file in the order of their exposure, and `image_recorded` in the meta is always
correct. If `pre_trigger_s` is longer, the images that a window takes from the line come after newer metas,
and their own metas, written before, state that the images are not recorded.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from typing import Final

from acquire.frames.frame import Frame
from acquire.recorder.frame_file import FrameFile
from acquire.recorder.frame_format import FrameFormat
from acquire.recorder.frame_recorder import DelayedFrame, FrameRecorder
from acquire.recorder.paged.copied_queue import CopiedQueue
from schemas.rig import RecorderConfig

META_WAIT_S: Final = 0.25
"""longest wait of a frame's meta for a trigger [s]"""


class WindowRecorder(FrameRecorder):
    """Recorder of windows (time spans of strikes) with the time before them, and of single images between."""

    def __init__(
        self,
        queue: CopiedQueue,
        file: FrameFile,
        frames: FrameFormat,
        config: RecorderConfig,
        wall_anchor_ns: int,
    ) -> None:
        """Start to record, with no window (time span of a strike) open.

        Args:
            queue: buffers and queue of copied frames before the file.
            file: writer of the images and their metadata.
            frames: camera name, size and rate of the frames.
            config: times of a window [s], and rate of the previews [Hz].
            wall_anchor_ns: log time minus host monotonic time [ns].
        """
        super().__init__(queue, file, frames, config, wall_anchor_ns)
        self._queue = queue
        self._meta_wait_ns = min(self._pre_trigger_ns, int(META_WAIT_S * 1e9))
        self._preview_ns = 1e9 / config.preview_hz if config.preview_hz > 0 else math.inf
        self._next_preview_ns = 0.0 if config.preview_hz > 0 else math.inf
        self._with_meta = 0
        """number of the oldest frames in the delay line whose meta is in the file, or on its way"""

    def _take(self, frame: Frame) -> DelayedFrame:
        copied = self._queue.copy(frame)
        if copied is None:
            self._reclaim_buffer()
            copied = self._queue.copy(frame)
        return DelayedFrame(copied or frame, has_image=copied is not None, held=copied is not None)

    def _reclaim_buffer(self) -> None:
        """Free the image buffer of the oldest frame that has one, to make room for a new frame.

        That frame and all older ones leave the delay line (queue of recent frames). Their meta (FrameMeta
        messages) are written if still missing in the file; the image in the freed buffer is lost.
        """
        with self._lock:
            while self._line and not self._line[0].held:
                self._forget_before(self._line[0].frame.mid_exposure_ns + 1)
            if self._line:
                self._line[0].has_image = False
                self._forget_before(self._line[0].frame.mid_exposure_ns + 1)

    # --- under the lock ---

    def _record(self, delayed: DelayedFrame) -> None:
        if delayed.has_image:
            self._write_image(delayed)
        else:
            self._queue.write_dropped(delayed.frame)

    def _delay(self, delayed: DelayedFrame) -> None:
        self._line.append(delayed)
        mid_ns = delayed.frame.mid_exposure_ns
        self._write_meta_before(mid_ns - self._meta_wait_ns)
        self._forget_before(mid_ns - self._pre_trigger_ns)

    def _claim(self, start_ns: int) -> Iterable[DelayedFrame]:
        self._forget_before(start_ns)
        for number, delayed in enumerate(self._line):
            if number >= self._with_meta:
                self._record(delayed)
            elif delayed.held:
                self._write_image(delayed, with_meta=False)
        self._with_meta = 0
        claimed, self._line = self._line, deque()
        return claimed

    def _end_delay(self) -> None:
        self._write_meta_before(self._newest_ns + 1)

    def _write_image(self, delayed: DelayedFrame, *, with_meta: bool = True) -> None:
        """Queue a frame's image for writing, and its meta (FrameMeta message) if `with_meta`.

        The writing queue then owns the image's buffer: `delayed.held` becomes False.
        """
        self._queue.write(delayed.frame, with_meta=with_meta)
        delayed.held = False

    def _write_meta_before(self, end_ns: int) -> None:
        """Write the metadata of recent frames exposed before `end_ns`, if not written yet.

        `end_ns` is a host monotonic time [ns]. Recent frames are those in the delay line (queue of the newest
        frames). A frame's image is written as well if a preview (single image between two strikes' windows)
        is due.
        """
        while self._with_meta < len(self._line):
            delayed = self._line[self._with_meta]
            mid_ns = delayed.frame.mid_exposure_ns
            if mid_ns >= end_ns:
                break
            self._with_meta += 1
            if mid_ns >= self._next_preview_ns and delayed.has_image:
                self._next_preview_ns = mid_ns + self._preview_ns
                self._write_image(delayed)
            else:
                self._queue.write_meta(delayed.frame)

    def _forget_before(self, start_ns: int) -> None:
        """Drop frames exposed before `start_ns` (host monotonic [ns]) from the queue of recent frames.

        Their meta (FrameMeta messages) is written first if it is still missing; their buffers are released.
        """
        self._write_meta_before(start_ns)
        while self._line and self._line[0].frame.mid_exposure_ns < start_ns:
            delayed = self._line.popleft()
            self._with_meta -= 1
            if delayed.held:
                delayed.frame.buffer.release()
