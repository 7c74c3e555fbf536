"""Frames on their way to the file in the camera's own buffers: nothing is copied, a buffer goes back when the disk has it.

Several frames are written together: first their checksums, which read every pixel and so leave nothing else in the processor's cache,
then all that is Python's, in one go.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from typing import Final, NamedTuple, Protocol

from acquire.errors import RecorderError
from acquire.recorder.messages import DiskBehind
from schemas.proto import percuss_pb2 as pb

BATCH_FRAMES: Final = 12
BATCH_NS: Final = 30_000_000
"""Frames are written together, so many or the frames of so long; the time is between exposures."""
STRAGGLER_S: Final = 0.05
"""between two looks whether frames wait and no more come"""
_LAST_S: Final = 1.0
_ROOM_S: Final = 5e-3
"""between two looks whether there is room again"""


class Lender(Protocol):
    """Whose memory an image lies in."""

    @property
    def pixels(self) -> memoryview:
        """The image's bytes; they begin on a page of the memory."""
        ...

    def keep(self) -> bool:
        """The image stays as it is until `release`; False: no buffer can take its place, and it is valid in this call only."""
        ...

    def release(self) -> None:
        """Once, after `keep`; from any thread."""
        ...


class LentFrame(NamedTuple):
    """A frame whose buffer is kept."""

    meta: pb.FrameMeta
    lender: Lender


class LentFrameFile(Protocol):
    """Where the frames go."""

    def lent(self, frames: list[LentFrame]) -> None:
        """Write their images, all or none; their meta knows it then, and their buffers are released when they are on the disk.

        Raises:
            DiskBehind: there is no room now.
            RecorderError: the disk is full or failing.
        """
        ...

    def metas(self, metas: list[pb.FrameMeta]) -> None:
        """Write the frames' meta.

        Raises:
            RecorderError: the disk is full or failing.
        """
        ...


class LentQueue:
    """Keeps the buffers of frames until they are on the disk. A frame is dropped, and counted, where no buffer can be kept.

    Frames are written by the thread that brings them, when enough have gathered: another one, on another core, would find none of the
    interpreter's data in its caches, and take twice as long. A thread of its own writes what is left when no more come.
    """

    def __init__(self, file: LentFrameFile) -> None:
        self.error: RecorderError | None = None
        self._file = file
        self._refused = self._failed = 0
        """frames that were dropped: when they came, and when they were to be written"""
        self._queue: deque[LentFrame | pb.FrameMeta] = deque()
        """a dropped frame's meta keeps its place"""
        self._newest_ns = 0
        """mid-exposure of the frame that was written last"""
        self._batches = 0
        self._lock = threading.Lock()
        """held by the thread that writes"""
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._write_stragglers, name="recorder-stragglers")
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Images that were not kept, or could not be written."""
        return self._refused + self._failed

    @property
    def waiting(self) -> int:
        """Frames that are not with the file yet."""
        return len(self._queue)

    def take(self, meta: pb.FrameMeta, mid_ns: int, lender: Lender | None) -> bool:
        """Whether the image was taken; its meta is in any case, as long as the disk works. Never waits for the disk."""
        queue = self._queue
        if lender is not None and self.error is None and lender.keep():
            queue.append(LentFrame(meta, lender))
            taken = True
        else:
            self._refused += 1
            queue.append(meta)
            taken = False
        if len(queue) >= BATCH_FRAMES or mid_ns - self._newest_ns >= BATCH_NS:
            self._newest_ns = mid_ns
            with self._lock:
                self._write_batch()
        if self._ending.is_set():  # it came while the queue was closed: nobody else looks after it any more
            self.wait_until_written(_LAST_S)
        return taken

    def wait_until_written(self, timeout_s: float) -> None:
        """Write what waits, meta included: on return no other thread is at it either, unless the time is up."""
        end = time.monotonic() + timeout_s
        while True:
            with self._lock:
                written = self._write_batch()
                if not self._queue:  # seen without the lock it may be empty while another thread still writes the meta
                    return
            if time.monotonic() >= end:
                return
            if not written:
                time.sleep(_ROOM_S)

    def close(self) -> None:
        """Write what waits and end the thread. Safe to call twice."""
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
        """Write the oldest frames; False where there is no room for them now."""
        queue = self._queue
        batch = [queue[number] for number in range(min(len(queue), BATCH_FRAMES))]
        if not batch:  # another thread wrote it
            return True
        frames = [each for each in batch if isinstance(each, LentFrame)]
        if frames and not self._write(frames):
            return False
        for _ in batch:
            queue.popleft()
        self._batches += 1
        try:
            self._file.metas([each.meta if isinstance(each, LentFrame) else each for each in batch])
        except RecorderError as error:
            self.error = error
        return True

    def _write(self, frames: list[LentFrame]) -> bool:
        if self.error is None:
            try:
                self._file.lent(frames)
            except DiskBehind:
                return False  # frames that were kept have a place: one that comes soon
            except RecorderError as error:
                self.error = error
            else:
                return True
        self._failed += len(frames)
        for frame in frames:
            frame.lender.release()
        return True
