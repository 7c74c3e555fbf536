"""Lent images whose memory is written over as soon as it is given back: whoever still reads it then will notice."""

from __future__ import annotations

import mmap

import numpy as np
from numpy.typing import NDArray

from acquire.recorder.checksum import crc_of
from acquire.recorder.image import RawImageEncoder
from acquire.recorder.messages import LentImage
from acquire.recorder.page_memory import PAGE, page_memory

T0 = 1_700_000_000_000_000_000
PERIOD_NS = 1_000_003


class Lender:
    """One image's memory. It counts."""

    def __init__(self, image: NDArray[np.uint8], keeps: bool = True) -> None:
        memory: mmap.mmap = page_memory(image.size)
        self.image = np.frombuffer(memory, np.uint8)[: image.size].reshape(image.shape)
        self.image[:] = image
        assert self.image.ctypes.data % PAGE == 0
        self.keeps = keeps
        self.kept = self.released = 0

    @property
    def pixels(self) -> memoryview:
        return memoryview(self.image).cast("B")

    def keep(self) -> bool:
        self.kept += self.keeps
        return self.keeps

    def release(self) -> None:
        self.image[:] = 0xAA
        self.released += 1


def image_of(width: int, height: int, number: int) -> NDArray[np.uint8]:
    return np.random.default_rng(number).integers(0, 0xAA, (height, width), dtype=np.uint8)


def lent_image(lender: Lender, number: int) -> LentImage:
    height, width = lender.image.shape
    time_ns = T0 + number * PERIOD_NS
    prefix = RawImageEncoder("camera", width, height).prefix(time_ns, width * height)
    return LentImage(time_ns, number, prefix, lender.pixels, crc_of(lender.pixels), lender.release)
