"""Path of frames to the disk past the page cache, directly from the camera's own buffers.

The other path is paged/copied_queue.py; choose_recorder.py chooses.

Several frames are written together: first their checksums, which read every pixel and therefore leave nothing
else in the processor's cache, then everything that runs in Python.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from typing import Final

from acquire.errors import RecorderError
from acquire.frames.frame import Frame
from acquire.recorder.frame_file import FrameFile
from acquire.recorder.frame_path import FramePath
from acquire.recorder.messages import DiskBehind

BATCH_FRAMES: Final = 12
BATCH_NS: Final = 30_000_000
"""span of exposures [ns] after which waiting frames are written together, even if fewer than BATCH_FRAMES"""
STRAGGLER_S: Final = 0.05
"""interval between two checks for frames that wait while no more arrive [s]"""
LATE_FRAME_TIMEOUT_S: Final = 1.0
"""longest wait for the disk with a frame that arrives while the queue closes [s]"""
_ROOM_POLL_S: Final = 5e-3


class BorrowedQueue(FramePath):
    """Queue of frames before a file; it borrows (keeps) camera buffers until the disk has their images.

    A frame whose buffer cannot be borrowed is dropped and counted.

    The thread that brings the frames writes them once enough have gathered: another thread, on another core,
    would find none of the interpreter's data in its caches and take twice as long. The queue's own thread
    writes what is left when no more frames arrive.
    """

    def __init__(self, file: FrameFile) -> None:
        super().__init__()
        self._file = file
        self._queue: deque[tuple[Frame, bool]]
        """frames, and True if the buffer is borrowed; a dropped frame keeps its place for its meta"""
        self._newest_ns = 0
        """mid-exposure of the frame that began the newest batch"""
        self._batches = 0
        self._lock = threading.Lock()
        """held by the thread that writes"""
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._write_stragglers, name="recorder-stragglers")
        self._thread.start()

    def take(self, frame: Frame) -> bool:
        """Queue a frame, borrow (keep) its camera buffer, and write the queued frames if a batch is due.

        A batch is due with BATCH_FRAMES frames in the queue, or BATCH_NS after the last one began (in times
        of exposure). The call does not wait for the disk, except up to LATE_FRAME_TIMEOUT_S while the queue
        closes.

        Returns:
            True if the buffer was borrowed. False if the image was dropped because no buffer was free or the
            file failed; its meta (FrameMeta message) is queued all the same.
        """
        queue = self._queue
        borrowed = self.error is None and frame.buffer.borrow()
        self._refused += not borrowed
        queue.append((frame, borrowed))
        if len(queue) >= BATCH_FRAMES or frame.mid_exposure_ns - self._newest_ns >= BATCH_NS:
            self._newest_ns = frame.mid_exposure_ns
            with self._lock:
                self._write_batch()
        if self._ending.is_set():
            # The frame arrived while the queue closed: no other thread writes it any more.
            self.wait_until_written(LATE_FRAME_TIMEOUT_S)
        return borrowed

    def wait_until_written(self, timeout_s: float) -> None:
        """Write the waiting frames, or drop their images after an error, for at most `timeout_s` seconds.

        On return the queue is empty and no other thread writes, unless the time is up; that is no error.
        """
        end = time.monotonic() + timeout_s
        while True:
            with self._lock:
                written = self._write_batch()
                # Read under the lock: without it the queue may be empty while another thread writes the meta.
                if not self._queue:
                    return
            if time.monotonic() >= end:
                return
            if not written:
                time.sleep(_ROOM_POLL_S)

    def close(self) -> None:
        """Write the waiting frames, however long that takes, and end the queue's thread.

        After an error of the disk the waiting images are dropped and counted in `dropped`; the error is in
        `error` and is not raised. Safe to call twice.
        """
        self._ending.set()
        self._thread.join()
        self.wait_until_written(math.inf)

    def _write_stragglers(self) -> None:
        seen = 0
        while not self._ending.wait(STRAGGLER_S):
            if self._queue and self._batches == seen:
                with self._lock:
                    self._write_batch()
            seen = self._batches

    # --- under the lock ---

    def _write_batch(self) -> bool:
        """Write images and meta (FrameMeta messages) of the oldest frames in the queue, at most BATCH_FRAMES.

        Called with the lock held.

        Returns:
            True if the frames left the queue, or it was empty; False if the file has no room for the images
            now.
        """
        queue = self._queue
        batch = [queue[number] for number in range(min(len(queue), BATCH_FRAMES))]
        if not batch:  # another thread wrote it
            return True
        try:
            recorded = self._write_images([frame for frame, borrowed in batch if borrowed])
        except DiskBehind:
            return False  # borrowed frames keep their buffers: room for them comes soon
        for _ in batch:
            queue.popleft()
        self._batches += 1
        try:
            self._file.write_metas([(frame, borrowed and recorded) for frame, borrowed in batch])
        except RecorderError as error:
            self.error = error
        return True

    def _write_images(self, frames: list[Frame]) -> bool:
        """Write images from borrowed camera buffers, or drop them: release the buffers, count the images.

        They are dropped after an error other than DiskBehind, now or earlier.

        Returns:
            True if the images were written; False if they were dropped, or the list is empty.

        Raises:
            DiskBehind: the file has no room for the images now; the buffers stay borrowed.
        """
        if frames and self.error is None:
            try:
                self._file.write_borrowed(frames)
            except DiskBehind:
                raise
            except RecorderError as error:
                self.error = error
            else:
                return True
        self._failed += len(frames)
        for frame in frames:
            frame.buffer.release()
        return False
