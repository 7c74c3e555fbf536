"""Path of frames to the disk through the page cache: copied to a buffer pool, written by a thread.

The other path is direct/borrowed_queue.py; choose_recorder.py chooses.
"""

from __future__ import annotations

import threading
from collections import deque
from typing import Final, NamedTuple

from acquire.errors import RecorderError
from acquire.frames.buffer_pool import BufferPool
from acquire.frames.frame import Frame
from acquire.recorder.frame_file import FrameFile
from acquire.recorder.frame_format import FrameFormat
from acquire.recorder.frame_path import FramePath

BATCH_BYTES: Final = 3 << 19
BATCH_S: Final = 0.02
"""longest wait [s] of a frame for others, up to BATCH_BYTES, to be written with in one MCAP chunk.

A buffered write of 1.3 MB takes a fifth less CPU per byte than one of 0.3 MB; above 2 MB ext4 (Linux 6.18)
takes twice as much.
"""


class _Queued(NamedTuple):
    frame: Frame
    with_image: bool
    """the frame's buffer is the queue's, to be written and released"""
    with_meta: bool = True


class CopiedQueue(FramePath):
    """Queue of frames before a file: they are copied into a buffer pool and written by a thread.

    Images that find no free buffer are dropped and counted.
    """

    def __init__(self, file: FrameFile, frames: FrameFormat, buffers: int) -> None:
        """Allocate the buffers and start the writing thread.

        Args:
            file: destination of the frames.
            frames: size of the images.
            buffers: number of images that may be held at a time, including those that wait for the opening of
                a window (time span of a strike).
        """
        super().__init__()
        self._pool = BufferPool(0, buffers, frames.image_bytes)
        self._file = file
        self._batch_frames = max(1, min(32, BATCH_BYTES // frames.image_bytes))
        self._change = threading.Condition()
        self._queue: deque[_Queued]
        self._writing = self._ending = False
        self._thread = threading.Thread(target=self._write_queue, name="recorder-write")
        self._thread.start()

    def take(self, frame: Frame) -> bool:
        """Copy a frame and queue it for writing. Never waits for the disk.

        Returns:
            True if the image was copied; False if it was dropped because no buffer was free. The meta
            (FrameMeta message) is queued in both cases.
        """
        copied = self.copy(frame)
        if copied is None:
            self.write_dropped(frame)
            return False
        self.write(copied)
        return True

    def copy(self, frame: Frame) -> Frame | None:
        """Copy a frame into a buffer of the pool; the caller must pass the copy to `write` or release it.

        Returns:
            The copy; None if no buffer is free.
        """
        return self._pool.copy(frame)

    def write(self, frame: Frame, *, with_meta: bool = True) -> None:
        """Queue a frame made by `copy` for writing; its buffer is released afterwards.

        Args:
            frame: the copied frame.
            with_meta: True to write the frame's meta (FrameMeta message) as well.
        """
        self._put(_Queued(frame, with_image=True, with_meta=with_meta))

    def write_meta(self, frame: Frame) -> None:
        """Queue a frame's meta (FrameMeta message: times, exposure, losses) without its image."""
        self._put(_Queued(frame, with_image=False))

    def write_dropped(self, frame: Frame) -> None:
        """Queue a frame's meta (FrameMeta message) without its image, and count the image as dropped."""
        self._refused += 1
        self.write_meta(frame)

    def wait_until_written(self, timeout_s: float) -> None:
        """Wait until all queued frames are written or dropped, at most `timeout_s` seconds."""
        with self._change:
            self._change.wait_for(lambda: not self._queue and not self._writing, timeout_s)

    def close(self) -> None:
        """Write the waiting frames, or drop their images after an error, and end the thread.

        An error is kept in `error`, not raised. Safe to call twice.
        """
        with self._change:
            self._ending = True
            self._change.notify_all()
        self._thread.join()

    def _put(self, queued: _Queued) -> None:
        with self._change:
            self._queue.append(queued)
            if len(self._queue) == self._batch_frames:
                self._change.notify_all()

    # --- writing thread ---

    def _write_queue(self) -> None:
        while batch := self._next_batch():
            recorded = self._write_images([queued.frame for queued in batch if queued.with_image])
            for frame, with_image, with_meta in batch:
                if with_meta:
                    self._write_meta(frame, with_image and recorded)
                if with_image:
                    frame.buffer.release()

    def _next_batch(self) -> list[_Queued]:
        """Wait for frames, and take those that are written together from the queue.

        Returns:
            Frames to write, with or without image and meta (FrameMeta message): at least one, at most
            `_batch_frames`; an empty list once the queue is closed and empty.
        """
        with self._change:
            self._writing = False
            while True:
                if not self._queue:
                    self._change.notify_all()
                # At line rate a wake-up and a chunk for each frame would cost more than the frame: let a few
                # gather.
                self._change.wait_for(lambda: len(self._queue) >= self._batch_frames or self._ending, BATCH_S)
                if self._queue or self._ending:
                    break
            self._writing = bool(self._queue)
            return [self._queue.popleft() for _ in range(min(len(self._queue), self._batch_frames))]

    def _write_images(self, frames: list[Frame]) -> bool:
        """Write the images of frames together; after an error count them as dropped instead.

        Returns:
            True if the images were written, or `frames` is empty; False if the file failed, now or earlier.
        """
        try:
            if frames and self.error is None:
                self._file.write_images(frames)
        except RecorderError as error:
            self.error = error
        if self.error is not None:
            self._failed += len(frames)
        return self.error is None

    def _write_meta(self, frame: Frame, recorded: bool) -> None:
        try:
            self._file.write_metas([(frame, recorded)])
        except RecorderError as error:
            self.error = error
