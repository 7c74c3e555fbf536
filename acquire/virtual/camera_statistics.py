"""Statistics of a virtual camera, of whatever kind, and the rendering that they count."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from acquire.clock.clock import Clock
    from acquire.virtual.image_source import ImageSource, StreamSettings


@dataclass(frozen=True)
class CameraStatistics:
    """Frames sent by the virtual camera since it was made, mean rendering time and largest delay [ms].

    An image's delay is the time from the end of its exposure until it is rendered. An image counts as late
    if its delay exceeds two frame periods.

    On a busy computer images wait to be rendered. A client that then opens the camera anew never gets them,
    and counts them as lost, though nothing was lost on the way: the camera counts them as unsent.
    """

    frames: int
    """number of frames sent"""
    render_ms_mean: float
    """mean time to render an image [ms]; 0 if none was rendered"""
    late: int
    """number of exposures whose image was ready more than two frame periods after their end"""
    latest_ms: float
    """largest delay [ms] of an image after the end of its exposure"""
    unsent: int
    """number of late images that were still to be rendered when their stream ended, and another followed"""


class CountedSource:
    """Image source of a virtual camera that counts its images, and how late they are.

    Args:
        source: source of the images.
        clock: the host's clock.
    """

    def __init__(self, source: ImageSource, clock: Clock) -> None:
        self.frames = 0
        """number of frames sent, counted by the camera"""
        self._source, self._clock = source, clock
        self._rendered = self._late = self._latest_ns = 0
        self._render_s = 0.0
        self._left = self._unsent = 0

    def begin_stream(self) -> None:
        """Count the images that an earlier stream has left as unsent."""
        self._unsent, self._left = self._unsent + self._left, 0

    def end_stream(self, start_ns: int, exposure_ns: int, period_ns: int) -> None:
        """Keep the number of images that a stream has left: those that are late now.

        Args:
            start_ns: begin of the exposure whose image was next (host monotonic) [ns].
            exposure_ns: exposure [ns].
            period_ns: frame period [ns].
        """
        delay_ns = self._clock.monotonic_ns() - start_ns - exposure_ns
        self._left = max(0, delay_ns // period_ns - 1)

    def image(self, start_ns: int, settings: StreamSettings, period_ns: int) -> NDArray[np.uint8]:
        """Render the image whose exposure begins at `start_ns` (host monotonic) [ns], and count its delay.

        Args:
            start_ns: begin of the exposure.
            settings: settings of the stream.
            period_ns: frame period [ns].
        """
        began_s = time.perf_counter()
        image = self._source.image(start_ns, settings)
        self._render_s += time.perf_counter() - began_s
        self._rendered += 1
        delay_ns = self._clock.monotonic_ns() - start_ns - round(settings.exposure_us * 1e3)
        self._latest_ns = max(self._latest_ns, delay_ns)
        self._late += delay_ns > 2 * period_ns
        return image

    @property
    def statistics(self) -> CameraStatistics:
        """Statistics since the camera was made."""
        mean_ms = 1e3 * self._render_s / max(self._rendered, 1)
        return CameraStatistics(self.frames, mean_ms, self._late, self._latest_ns / 1e6, self._unsent)
