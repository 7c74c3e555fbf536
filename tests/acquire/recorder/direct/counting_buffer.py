"""Frame buffers that are overwritten as soon as they are released, so that a later reader is noticed."""

from __future__ import annotations

import mmap

import numpy as np
from numpy.typing import NDArray

from acquire.frames.frame import Frame
from acquire.frames.page_memory import PAGE_BYTES, page_memory
from acquire.recorder.checksum import crc_of
from acquire.recorder.image import RawImageEncoder
from acquire.recorder.messages import BorrowedImage

T0 = 1_700_000_000_000_000_000
PERIOD_NS = 1_000_003


class CountingBuffer:
    """FrameBuffer of one image that counts borrows and releases.

    It models no pool: it can be borrowed as long as `replaceable` is True.
    """

    def __init__(self, image: NDArray[np.uint8], replaceable: bool = True) -> None:
        memory: mmap.mmap = page_memory(image.size)
        self.image = np.frombuffer(memory, np.uint8)[: image.size].reshape(image.shape)
        self.image[:] = image
        assert self.image.ctypes.data % PAGE_BYTES == 0
        self.replaceable = replaceable
        self.borrows = self.released = 0

    @property
    def borrowed(self) -> bool:
        return self.borrows > 0

    @property
    def pixels(self) -> memoryview:
        return memoryview(self.image).cast("B")

    def borrow(self) -> bool:
        self.borrows += self.replaceable
        return self.replaceable

    def release(self) -> None:
        self.image[:] = 0xAA
        self.released += 1


def frame_in(buffer: CountingBuffer, number: int, mid_ns: int, lost: int = 0) -> Frame:
    return Frame(buffer.image, number, number, mid_ns, mid_ns, 1500.0, lost, buffer, mid_ns, 1000)


def image_of(width: int, height: int, number: int) -> NDArray[np.uint8]:
    return np.random.default_rng(number).integers(0, 0xAA, (height, width), dtype=np.uint8)


def borrowed_image(buffer: CountingBuffer, number: int) -> BorrowedImage:
    height, width = buffer.image.shape
    time_ns = T0 + number * PERIOD_NS
    prefix = RawImageEncoder("camera", width, height).prefix(time_ns, width * height)
    return BorrowedImage(time_ns, number, prefix, buffer.pixels, crc_of(buffer.pixels), buffer.release)
