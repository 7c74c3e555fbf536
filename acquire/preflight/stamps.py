"""At which instant of a frame the camera stamps it: found out from frames of two exposures.

A frame is sent once its exposure has ended. So the time from its stamp to its arrival grows with the exposure
if the camera stamps the exposure's start, and does not if it stamps the end.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from acquire.clock.clock import DeviceClockMapper
from acquire.errors import AcquireError
from acquire.preflight.check import Check, Measured, failed_check, passed_check, skipped_check

if TYPE_CHECKING:
    from acquire.camera.base import Camera
    from schemas.rig import CameraConfig

STAMP_LINE = "frame times"
"""name of the check"""
EXPOSURES_US = (300.0, 6300.0)
"""the two exposures [us]: their difference is many times what the arrival of a frame varies by"""
RATE_HZ = 60.0
"""highest frame rate of the measurement, so that the long exposure fits into a period [Hz]"""
FRAMES = 40
"""frames per exposure"""
QUANTILES = (0.1, 0.25, 0.5)
"""quantiles of the delays that are compared: a busy computer makes frames later, and then they disagree"""
LATCHES = 10
SLOPE_TOLERANCE = 0.3
"""largest difference of a slope [1] from that of an instant; under load it may be any number"""

Array = NDArray[np.float64]
MeasureStamp = Callable[["CameraConfig"], float | None]


def measure_stamp(make_camera: Callable[[CameraConfig], Camera], config: CameraConfig) -> float | None:
    """Change of the time from stamp to arrival over the change of the exposure: 1 for start, 0 for end.

    Args:
        make_camera: function that makes the camera of a configuration.
        config: the rig file's settings of the camera.

    Returns:
        The ratio; None if the camera's clock cannot be read, NaN if the frames arrive too unevenly to tell.

    Raises:
        AcquireError: the camera cannot be used at these exposures.
    """
    delays_us: list[Array] = []
    for exposure_us in EXPOSURES_US:
        # With the instant in the configuration a driver's own statement does not shift the stamps.
        changes = {
            "exposure_us": exposure_us,
            "frame_rate_hz": min(RATE_HZ, config.frame_rate_hz),
            "timestamp_at": config.timestamp_at,
        }
        delays = _delays_us(make_camera(config.model_copy(update=changes)))
        if delays is None:
            return None
        delays_us.append(delays)
    slopes = (delays_us[1] - delays_us[0]) / (EXPOSURES_US[1] - EXPOSURES_US[0])
    return float(slopes[1]) if np.ptp(slopes) < SLOPE_TOLERANCE else math.nan


def _delays_us(camera: Camera) -> Array | None:
    """Times from stamp to arrival of a camera's frames at QUANTILES [us]; None if its clock is hidden."""
    try:
        camera.open()
        mapper = DeviceClockMapper()
        for _ in range(LATCHES):
            if (reading := camera.latch_clock()) is None:
                return None
            mapper.add(reading)
        camera.start()
        found = []
        for _ in range(FRAMES):
            if (frame := camera.read(2.0)) is None:
                break
            found.append(1e-3 * (frame.host_time_ns - mapper.to_host(frame.device_time_ns)))
            frame.buffer.release()
        camera.stop()
        return np.quantile(found, QUANTILES) if found else None
    finally:
        camera.close()


def check_stamp(measure: MeasureStamp, config: CameraConfig) -> Check:
    """Check that the camera stamps the instant of a frame that the rig file states.

    Args:
        measure: function that measures the slope.
        config: the rig file's settings of the camera.
    """
    if config.trigger != "off":
        return skipped_check(STAMP_LINE, "pulses set the frames: try it with the trigger off")
    try:
        slope = measure(config)
    except AcquireError as error:
        return skipped_check(STAMP_LINE, f"the camera did not take two exposures ({error})")
    if slope is None or math.isnan(slope):
        hidden = "the camera's clock cannot be read; frames have arrival times"
        uneven = "frames arrive too unevenly on this busy computer: take load off it, then repeat"
        return skipped_check(STAMP_LINE, hidden if slope is None else uneven)
    stated = "exposure_end" if config.timestamp_at == "exposure_end" else "exposure_start"
    slopes = {"exposure_start": 1.0, "exposure_end": 0.0}
    found = next((each for each, usual in slopes.items() if abs(slope - usual) < SLOPE_TOLERANCE), "")
    measured = Measured(round(slope, 3), 1.0, "")
    text = f"stamps move {slope:.2f} of the exposure away from the arrival"
    if not found:
        return failed_check(
            STAMP_LINE, f"{text}: neither start nor end", "take load off this computer, then repeat", measured
        )
    by_driver = config.traits.driver_states_instant and "timestamp_at" not in config.model_fields_set
    if by_driver or found != stated:
        bias_ms = 1e-3 * config.exposure_us
        meaning = (
            "so far its driver's statement counts"
            if by_driver
            else f"the rig file says {_words(stated)}; frame times are off by {bias_ms:g} ms"
        )
        return failed_check(
            STAMP_LINE,
            f"{text}: the camera stamps the {_words(found)}, {meaning}",
            f'write timestamp_at = "{found}" in the rig file\'s [camera]',
            measured,
        )
    return passed_check(STAMP_LINE, f"{text}: {_words(found)}, as stated", measured)


def _words(instant: str) -> str:
    return {"exposure_start": "start of the exposure", "exposure_end": "end of the exposure"}[instant]
