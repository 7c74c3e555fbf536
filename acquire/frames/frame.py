"""One frame, from the camera's stream to the file."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray


class FrameBuffer(Protocol):
    """The buffer that holds the pixels of one frame."""

    @property
    def borrowed(self) -> bool:
        """True once `borrow` has succeeded; it stays true after the release."""
        ...

    def borrow(self) -> bool:
        """Keep the pixels unchanged until `release`.

        Returns:
            False if the pool has no other buffer to take its place: the pixels are valid during the current
            call only.
        """
        ...

    def release(self) -> None:
        """Give the buffer back, once.

        Any thread may release a borrowed buffer, also after its camera closed.
        """
        ...


class Frame(NamedTuple):
    """A complete frame; its pixels are valid until its buffer is released.

    A named tuple, because one is made for every frame on the camera's thread: a frozen dataclass takes three
    times as long.
    """

    image: NDArray[np.uint8]
    """(height, width) mono8"""
    sequence: int
    """number of complete frames before this one: since the start, or since the stream began once it is
    mapped"""
    frame_id: int
    """GVSP block id"""
    device_time_ns: int
    """camera clock, start of exposure"""
    host_time_ns: int
    """host monotonic clock, at arrival"""
    exposure_us: float
    lost_before: int
    """frames lost between the previous complete frame and this one"""
    buffer: FrameBuffer
    mid_exposure_ns: int = 0
    """host monotonic clock; 0 until the camera's stream maps the device time"""
    mapping_sd_ns: int = 0
    """1 sigma of `mid_exposure_ns`"""

    @property
    def pixels(self) -> memoryview:
        """The image's bytes, row by row."""
        return self.image.data.cast("B")
