"""Statistics of a virtual camera, of whatever kind."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CameraStatistics:
    """Frames sent by the virtual camera since it was made, mean rendering time and largest delay [ms].

    An image's delay is the time from the end of its exposure until it is rendered. An image counts as late
    if its delay exceeds two frame periods.
    """

    frames: int
    """number of frames sent"""
    render_ms_mean: float
    """mean time to render an image [ms]; 0 if none was rendered"""
    late: int
    """number of exposures whose image was ready more than two frame periods after their end"""
    latest_ms: float
    """largest delay [ms] of an image after the end of its exposure"""
