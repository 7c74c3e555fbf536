"""Frames that are copied on their way to the file: through a queue and a thread of its own, or at once where the file never waits."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from acquire.errors import RecorderError
from acquire.recorder.checksum import crc_of
from acquire.recorder.direct.borrowed_queue import LentFrame
from acquire.recorder.image import RawImageEncoder, png_message
from acquire.recorder.messages import DiskBehind, ImageMessage, LentImage, SmallMessage
from acquire.recorder.ring import ImageRing
from acquire.recorder.writer import Channel
from schemas import topics
from schemas.mcap.records import Buffer
from schemas.proto import percuss_pb2 as pb

BATCH_BYTES: Final = 3 << 19
BATCH_S: Final = 0.02
"""Frames go to the file together, up to this size and no later than this: one wake-up, one chunk, one system call.

A buffered write of 1.3 MB takes a fifth less CPU per byte than one of 0.3 MB; above 2 MB ext4 (Linux 6.18) takes twice as much.
"""
FRAME_ID: Final = "camera"
"""Foxglove's name for C; the calibration carries the same"""


class ImageSink(Protocol):
    """Where messages go: one file, or a row of them."""

    @property
    def never_waits(self) -> bool:
        """Whether `write_images` returns without waiting for the disk."""
        ...

    def add_topic(self, topic: topics.Topic) -> Channel:
        """Make a channel."""
        ...

    def write(self, channel: Channel, log_time_ns: int, data: Buffer, sequence: int = 0) -> None:
        """Write one small message."""
        ...

    def write_small(self, channel: Channel, messages: Sequence[SmallMessage]) -> None:
        """Write several."""
        ...

    def write_images(self, channel: Channel, messages: Sequence[ImageMessage]) -> None:
        """Write images together."""
        ...

    def write_lent(self, channel: Channel, images: Sequence[LentImage]) -> None:
        """Write images from where they lie."""
        ...

    def flush(self) -> None:
        """Hand small topics to the file now."""
        ...


class FrameFile:
    """Image and meta topics of one camera in a recording. `raw`: of this width and height; else PNG."""

    def __init__(self, sink: ImageSink, camera: str, raw: tuple[int, int] | None, wall_anchor_ns: int) -> None:
        self._sink = sink
        self._anchor = wall_anchor_ns
        self._raw = RawImageEncoder(FRAME_ID, *raw) if raw else None
        self._images = sink.add_topic(topics.raw_image(camera) if raw else topics.compressed_image(camera))
        self._metas = sink.add_topic(topics.frame_meta(camera))

    def images(self, frames: Sequence[tuple[pb.FrameMeta, NDArray[np.uint8]]]) -> None:
        """Write images together; their meta knows it then.

        Raises:
            RecorderError: none was written.
        """
        messages: list[ImageMessage] = []
        for meta, image in frames:
            log_time = self._anchor + meta.mid_exposure_host_ns
            data: list[Buffer] = self._raw.encode(log_time, image) if self._raw else [png_message(FRAME_ID, log_time, image)]
            messages.append(ImageMessage(log_time, data, meta.sequence))
        self._sink.write_images(self._images, messages)
        for meta, _ in frames:
            meta.image_recorded = True

    def lent(self, frames: list[LentFrame]) -> None:
        """See LentFrameFile."""
        if self._raw is None:
            raise RecorderError("images are lent only where they are written raw")
        anchor, prefix = self._anchor, self._raw.prefix
        pixels = [frame.lender.pixels for frame in frames]
        crcs = [crc_of(each) for each in pixels]
        images: list[LentImage] = []
        for (meta, lender), each, crc in zip(frames, pixels, crcs, strict=True):
            log_time = anchor + meta.mid_exposure_host_ns
            images.append(LentImage(log_time, meta.sequence, prefix(log_time, len(each)), each, crc, lender.release))
        self._sink.write_lent(self._images, images)
        for meta, _ in frames:
            meta.image_recorded = True

    def metas(self, metas: list[pb.FrameMeta]) -> None:
        """See LentFrameFile."""
        anchor = self._anchor
        messages = [SmallMessage(anchor + meta.mid_exposure_host_ns, meta.SerializeToString(), meta.sequence) for meta in metas]
        self._sink.write_small(self._metas, messages)

    def meta(self, meta: pb.FrameMeta) -> None:
        """Write a frame's meta.

        Raises:
            RecorderError: the disk is full or failing.
        """
        self._sink.write(self._metas, self._anchor + meta.mid_exposure_host_ns, meta.SerializeToString(), sequence=meta.sequence)

    def flush(self) -> None:
        """On return others can read in the file what was written before."""
        self._sink.flush()


class Queued(NamedTuple):
    """What is to be written of a frame."""

    meta: pb.FrameMeta
    slot: int | None
    """of its image; None: no image"""
    with_meta: bool = True


class FrameQueue:
    """Slots for images, a queue, and the thread that empties it. `slots`: images that may wait, those of a delay line included.

    What does not fit is dropped, and counted.
    """

    def __init__(self, file: FrameFile, slots: int, height: int, width: int) -> None:
        self.dropped = 0
        self.error: RecorderError | None = None
        self.ring = ImageRing(slots, height, width)
        self._file = file
        self._batch_frames = max(1, min(32, BATCH_BYTES // (width * height)))
        self._change = threading.Condition()
        self._queue: deque[Queued] = deque()
        self._writing = self._ending = False
        self._thread = threading.Thread(target=self._write_queue, name="recorder-write")
        self._thread.start()

    def put(self, queued: Queued) -> None:
        """Have it written. Never waits."""
        with self._change:
            self._queue.append(queued)
            if len(self._queue) == self._batch_frames:
                self._change.notify_all()

    @property
    def waiting(self) -> int:
        """Frames that are not written yet."""
        return len(self._queue)

    def wait_until_written(self, timeout_s: float) -> None:
        """Wait until everything was written that was put in before."""
        with self._change:
            self._change.wait_for(lambda: not self._queue and not self._writing, timeout_s)

    def close(self) -> None:
        """Write what waits and end the thread. Safe to call twice."""
        with self._change:
            self._ending = True
            self._change.notify_all()
        self._thread.join()

    # --- writing thread ---

    def _write_queue(self) -> None:
        while batch := self._next_batch():
            kept = [(queued.meta, self.ring.image(queued.slot)) for queued in batch if queued.slot is not None]
            try:
                if kept and self.error is None:
                    self._file.images(kept)
            except RecorderError as error:
                self.error = error
            if self.error is not None:
                self.dropped += len(kept)
            for queued in batch:
                if queued.with_meta:
                    self._write_meta(queued.meta)
                if queued.slot is not None:
                    self.ring.give_back(queued.slot)

    def _next_batch(self) -> list[Queued]:
        """Frames that are written together; none at the end."""
        with self._change:
            self._writing = False
            while True:
                if not self._queue:
                    self._change.notify_all()
                # At line rate a wake-up and a chunk for each frame would cost more than the frame: let a few gather.
                self._change.wait_for(lambda: len(self._queue) >= self._batch_frames or self._ending, BATCH_S)
                if self._queue or self._ending:
                    break
            self._writing = bool(self._queue)
            return [self._queue.popleft() for _ in range(min(len(self._queue), self._batch_frames))]

    def _write_meta(self, meta: pb.FrameMeta) -> None:
        try:
            self._file.meta(meta)
        except RecorderError as error:
            self.error = error


class AtOnce:
    """Writes each frame in the thread that brings it: one copy, no other thread to wake. For a file that never waits for the disk."""

    def __init__(self, file: FrameFile) -> None:
        self.dropped = 0
        self.error: RecorderError | None = None
        self._file = file

    def write(self, meta: pb.FrameMeta, image: NDArray[np.uint8]) -> bool:
        """Whether the image was taken; its meta is in any case, as long as the disk works."""
        taken = False
        try:
            if self.error is None:
                self._file.images([(meta, image)])
                taken = True
        except DiskBehind:
            pass
        except RecorderError as error:
            self.error = error
        self.dropped += not taken
        try:
            self._file.meta(meta)
        except RecorderError as error:
            self.error = error
        return taken
