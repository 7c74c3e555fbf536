"""Recorders of a camera's frames: base class with windows, and the recorder of every frame.

A window is the time span of one strike. A new frame outside any window stays in the delay line, a queue of
the frames of the last `pre_trigger_s`, from which a window that opens takes its first frames. A frame's meta
is its FrameMeta message (times, exposure, losses).
"""

from __future__ import annotations

import math
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from acquire.errors import RecorderError
from acquire.frames.frame import Frame
from acquire.recorder.frame_file import FrameFile
from acquire.recorder.frame_format import FrameFormat
from acquire.recorder.frame_path import FramePath
from schemas.rig import RecorderConfig

LATE_FRAME_S: Final = 0.25
"""longest wait of a closing window for frames that were exposed before it closed [s]"""
WRITE_TIMEOUT_S: Final = 30.0
"""longest wait of a closing window for the disk [s]"""


@dataclass(frozen=True)
class WindowReport:
    """Content of a closed window (the time span of one strike): its times, numbers of images and losses.

    `start_ns` and `end_ns` are log times [ns] of its first and last image, or start and end of the window if
    it has no image.
    """

    start_ns: int
    end_ns: int
    frames: int
    """number of images in the window"""
    lost: int
    """frames that should be in the window and are not: lost on the way from the camera, or dropped by a slow
    disk"""


@dataclass(slots=True)
class DelayedFrame:
    """A frame in the queue of recent frames, which may become part of a window (time span of a strike)."""

    frame: Frame
    has_image: bool
    """True if the image is in the file, on its way there, or can still be written"""
    held: bool = False
    """True while the queue of recent frames owns the frame's buffer, and must release it"""


@dataclass
class _Window:
    """An open or closing window (time span of a strike); its times are host monotonic times [ns]."""

    start_ns: int
    end_ns: int | None = None
    """end of the window [ns]; None while the window is open"""
    first_ns: int = 0
    """mid-exposure of the first image [ns]; 0 while there is none"""
    last_ns: int = 0
    """mid-exposure of the last image [ns]; 0 while there is none"""
    frames: int = 0
    """number of images recorded"""
    lost: int = 0
    """number of images lost, or dropped by a slow disk"""

    def add(self, delayed: DelayedFrame) -> None:
        """Count a frame in this window (time span of a strike): as an image recorded, or as one lost.

        It is lost if it has no image. Frames lost on the way from the camera just before it are counted as
        lost too, unless the window has no image yet.
        """
        frame = delayed.frame
        self.lost += frame.lost_before if self.frames else 0
        if delayed.has_image:
            self.frames += 1
            self.last_ns = frame.mid_exposure_ns
            self.first_ns = self.first_ns or self.last_ns
        else:
            self.lost += 1


class FrameRecorder(ABC):
    """Recorder of a camera's frames, between the acquisition thread, which calls `add`, and the file.

    Another thread opens and closes windows. A window is the time span of one strike; each subclass decides
    which images outside it are recorded.

    Raises:
        RecorderError: from `open_window` if a window is open, from `close_window` if none is, and from both
            if the file can take no images.
    """

    def __init__(
        self,
        path: FramePath,
        file: FrameFile,
        frames: FrameFormat,
        config: RecorderConfig,
        wall_anchor_ns: int,
    ) -> None:
        """Start to record, with no window (time span of a strike) open.

        Args:
            path: queue of frames before the file.
            file: writer of the images and their metadata.
            frames: camera name, size and rate of the frames.
            config: recorder section of the rig; `pre_trigger_s` and `max_window_s` are used here.
            wall_anchor_ns: log time minus host monotonic time [ns].
        """
        self.frames = 0
        """frames that arrived"""
        self.lost = 0
        """frames lost on the way from the camera"""
        self._path = path
        self._file = file
        self._anchor = wall_anchor_ns
        self._period_ns = 1e9 / frames.frame_rate_hz
        self._pre_trigger_ns = int(config.pre_trigger_s * 1e9)
        self._max_window_ns = int(config.max_window_s * 1e9) + self._pre_trigger_ns
        self._line: deque[DelayedFrame] = deque()
        """frames that may still become part of a window, oldest first"""
        self._lock = threading.Lock()
        self._arrived = threading.Condition(self._lock)
        """notified with each frame while `_awaited`"""
        self._awaited = False
        self._ending = False
        self._window: _Window | None = None
        self._newest_ns = 0

    @property
    def dropped(self) -> int:
        """Number of images that should be in the file and are not, because the disk was too slow or full."""
        return self._path.dropped

    @property
    def waiting(self) -> int:
        """Number of frames in the queue before the file; images that the file has in memory do not count."""
        return self._path.waiting

    @property
    def error(self) -> RecorderError | None:
        """Reason why the file accepts no more images, as a RecorderError; None while it accepts them."""
        return self._path.error

    def add(self, frame: Frame) -> None:
        """Take a new frame: keep its image (buffer or copy), and count the frame in a window that is open.

        A window is the time span of one strike. The call does not wait for the disk, except up to 1 s while
        the recorder closes. After `close` it does nothing.
        """
        if self._ending:
            return
        delayed = self._take(frame)
        with self._lock:
            self.frames += 1
            self.lost += frame.lost_before
            self._newest_ns = frame.mid_exposure_ns
            window = self._window
            if window is not None and self._newest_ns <= self._last_ns_of(window):
                window.add(delayed)
                self._record(delayed)
            else:
                self._delay(delayed)
            if self._awaited:
                self._arrived.notify_all()

    def open_window(self, now_ns: int) -> int:
        """Open a window (time span of a strike): record every image from `pre_trigger_s` before now on.

        The window lasts until `close_window`; images later than `max_window_s` after now do not belong to it.

        Args:
            now_ns: host monotonic time [ns].

        Returns:
            Start of the window as a log time [ns].

        Raises:
            RecorderError: a window is open already, or the file accepts no more images.
        """
        with self._lock:
            if self._window is not None:
                raise RecorderError("a window is open already: close it first")
            if self.error is not None:
                raise self.error
            self._window = window = _Window(start_ns=now_ns - self._pre_trigger_ns)
            for delayed in self._claim(window.start_ns):
                window.add(delayed)
            return self._anchor + window.start_ns

    def close_window(self, now_ns: int, end_ns: int = 0) -> WindowReport:
        """End the open window now, wait until its images are in the file, and report its content.

        A window is the time span of one strike. The wait is limited: LATE_FRAME_S (0.25 s) for frames exposed
        before the end, WRITE_TIMEOUT_S (30 s) for the disk.

        Args:
            now_ns: host monotonic time [ns].
            end_ns: log time [ns] at which the window ends if that is before now; 0 or later: it ends now.

        Returns:
            Log times of the first and last image (without images, of the window's start and end), and numbers
            of recorded and lost frames.

        Raises:
            RecorderError: no window is open, or the file accepts no more images.
        """
        now_ns = min(now_ns, end_ns - self._anchor) if end_ns else now_ns
        with self._lock:
            window = self._window
            if window is None:
                raise RecorderError("no window is open")
            window.end_ns = now_ns
            self._awaited = True
            self._arrived.wait_for(lambda: self._newest_ns > now_ns, LATE_FRAME_S)
            self._awaited = False
            self._window = None
            if self._newest_ns <= now_ns:
                # A silent camera owes the frames up to the window's end; no later frame counts them for this
                # window.
                silence_end_ns = min(now_ns, window.start_ns + self._max_window_ns)
                silent_ns = silence_end_ns - max(self._newest_ns, window.start_ns)
                window.lost += max(0, math.floor(silent_ns / self._period_ns - 0.5))
        self._path.wait_until_written(WRITE_TIMEOUT_S)
        if self.error is not None:
            raise self.error
        self._file.flush()
        first_ns, last_ns = (window.first_ns, window.last_ns) if window.frames else (window.start_ns, now_ns)
        return WindowReport(self._anchor + first_ns, self._anchor + last_ns, window.frames, window.lost)

    def close(self) -> None:
        """Take no more frames, and write the images and frame metadata that wait for the disk.

        Images that are held in memory only in case a window (time span of a strike) opens are not written.
        Safe to call twice.
        """
        with self._lock:
            if not self._ending:
                self._ending = True
                self._end_delay()
        self._path.close()

    def _last_ns_of(self, window: _Window) -> int:
        """Host monotonic time [ns] of the latest mid-exposure that still belongs to a strike's window.

        The window is the time span whose images are recorded. The time is its end if it is closing, else
        `max_window_s` after it was opened, which is `pre_trigger_s` after its start.
        """
        return window.start_ns + self._max_window_ns if window.end_ns is None else window.end_ns

    @abstractmethod
    def _take(self, frame: Frame) -> DelayedFrame:
        """Borrow or copy the frame's pixels so that they outlive the camera's call. Called without the lock.

        Returns:
            The frame with its pixels kept; `has_image` is False if no buffer was free or the file failed.
        """

    @abstractmethod
    def _record(self, delayed: DelayedFrame) -> None:
        """Queue image and metadata of a frame of the open window for the file. Called with the lock held.

        A window is the time span of one strike.
        """

    @abstractmethod
    def _delay(self, delayed: DelayedFrame) -> None:
        """Append a frame outside of any window to the delay line, and drop frames older than `pre_trigger_s`.

        A window is the time span of one strike, the delay line the queue of recent frames. Called with the
        lock held.
        """

    @abstractmethod
    def _claim(self, start_ns: int) -> Iterable[DelayedFrame]:
        """Take the frames of an opening window from the queue of recent frames.

        Images and meta (FrameMeta messages) that are not recorded yet are recorded. The queue is empty
        afterwards. A window is the time span of one strike. Called with the lock held.

        Args:
            start_ns: start of the window, host monotonic time [ns].

        Returns:
            Frames of the queue exposed at `start_ns` or later, oldest first; earlier ones leave the queue.
        """

    @abstractmethod
    def _end_delay(self) -> None:
        """Write the meta (FrameMeta messages) of recent frames that the file does not have yet.

        Called with the lock held, once, when the recorder closes.
        """


class ContinuousRecorder(FrameRecorder):
    """Recorder of every frame; a window (time span of a strike) only determines which frames are counted."""

    def _take(self, frame: Frame) -> DelayedFrame:
        return DelayedFrame(frame, self._path.take(frame))

    def _record(self, delayed: DelayedFrame) -> None:
        """Do nothing: `_take` has queued the frame for the file already."""

    def _delay(self, delayed: DelayedFrame) -> None:
        self._line.append(delayed)
        self._forget_before(delayed.frame.mid_exposure_ns - self._pre_trigger_ns)

    def _claim(self, start_ns: int) -> Iterable[DelayedFrame]:
        self._forget_before(start_ns)
        claimed, self._line = self._line, deque()
        return claimed

    def _end_delay(self) -> None:
        """Do nothing: the meta (FrameMeta message) of every frame is queued for the file already."""

    def _forget_before(self, start_ns: int) -> None:
        while self._line and self._line[0].frame.mid_exposure_ns < start_ns:
            self._line.popleft()
