"""Interface of a source of a virtual camera's images, and the camera settings passed to the source."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class StreamSettings:
    """Settings made by the client: region of the sensor [px], exposure [us] and gain [dB]."""

    width: int
    """width of the region [px]"""
    height: int
    """height of the region [px]"""
    offset_x: int
    """first column of the region [px]"""
    offset_y: int
    """first row of the region [px]"""
    exposure_us: float
    gain_db: float


class ImageSource(Protocol):
    """Source of the virtual camera's images (rendered world or test pattern).

    Called from the camera's render thread only.
    """

    def latest_time_ns(self) -> int:
        """Host monotonic time [ns] up to which exposures can be rendered."""
        ...

    def image(self, start_ns: int, settings: StreamSettings) -> NDArray[np.uint8]:
        """Image (height, width), uint8, of the exposure that starts at the host monotonic time `start_ns`.

        Args:
            start_ns: start of the exposure [ns], which ends at or before `latest_time_ns()`.
            settings: region, exposure and gain; the image has the region's size.
        """
        ...
