"""One camera frame with its times and its buffer, from the camera's stream to the file."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray


class FrameBuffer(Protocol):
    """Interface of the memory that holds one frame's pixels.

    To borrow it is to keep the pixels after the reader of the frame has returned.
    """

    @property
    def borrowed(self) -> bool:
        """True once `borrow` has kept the pixels, and always for a copied frame; True after release, too."""
        ...

    def borrow(self) -> bool:
        """Keep the pixels unchanged until `release`.

        Returns:
            True if the buffer is borrowed; False if its pool has no other buffer to take its place: the
            pixels are then valid only until the reader of the frame returns.
        """
        ...

    def release(self) -> None:
        """Give the buffer back to its pool. Call it once for each frame.

        Any thread may release a borrowed buffer, also after its camera closed.
        """
        ...


class Frame(NamedTuple):
    """A complete camera frame: grey pixels (height, width), frame numbers and times [ns].

    Its pixels are valid until its buffer is released.

    A named tuple, because one is made for every frame on the camera's thread: a frozen dataclass takes three
    times as long.
    """

    image: NDArray[np.uint8]
    """(height, width) mono8, uint8"""
    sequence: int
    """number of complete frames before this one: since the camera started, or since the stream began once its
    times are mapped (`mid_exposure_ns`)
    """
    frame_id: int
    """block id of the GigE Vision stream protocol (GVSP)"""
    device_time_ns: int
    """start of exposure on the camera's clock [ns]"""
    host_time_ns: int
    """arrival on the host's monotonic clock [ns]"""
    exposure_us: float
    """exposure time [us]"""
    lost_before: int
    """frames lost between the previous complete frame and this one"""
    buffer: FrameBuffer
    """memory of `image`"""
    mid_exposure_ns: int = 0
    """middle of the exposure, host monotonic clock [ns]; 0 until the stream maps the device time"""
    mapping_sd_ns: int = 0
    """1 sigma of `mid_exposure_ns` [ns]"""

    @property
    def pixels(self) -> memoryview:
        """View of the image's bytes, row by row, width * height of them; the image is contiguous."""
        return self.image.data.cast("B")
