"""Instant of a frame that a video driver stamps, and the time from it to the start of the exposure."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from acquire.camera import v4l2_abi as abi

if TYPE_CHECKING:
    from schemas.rig import CameraConfig

UVC_DRIVER: Final = "uvcvideo"
UVC_HARDWARE_STAMPS: Final = Path("/sys/module/uvcvideo/parameters/hwtimestamps")


@dataclass(frozen=True)
class StampedInstant:
    """Instant that the stamps of a camera's frames mean, and how well it is known."""

    monotonic: bool
    """True if the stamps are of the host's monotonic clock; False: there are none, arrival times are used"""
    start_offset_ns: int
    """time from the stamp to the start of the exposure of the image's middle row [ns]"""
    warning: str
    """line for the user where the start of the exposure does not follow from the stamp; empty if it does"""


def stamped_instant(
    driver: str,
    flags: int,
    config: CameraConfig,
    exposure_us: float,
    hardware_stamps: Path = UVC_HARDWARE_STAMPS,
) -> StampedInstant:
    """Instant that the driver stamps, from the flags of its buffers and the rig file.

    A global shutter exposes all rows at once. The rows of a rolling one begin `line_time_s` after each other;
    the middle one counts for the image, as in the analysis. A `timestamp_at` in the rig file has been found
    out by measurement, and goes before what the driver states: the stream then subtracts or adds half of the
    exposure.

    The driver of webcams declares its stamps as starts of exposure, but by default reads the clock when the
    first packet of an image arrives (`uvc_video.c`, uvc_video_decode_start); only with its option
    `hwtimestamps` it works them out from the camera's own. The first packet is sent when the first row has
    been exposed, or up to a frame period later if the camera compresses or stores the image.

    Args:
        driver: name of the driver.
        flags: flags of a buffer.
        config: section `camera` of the rig file.
        exposure_us: exposure time [us].
        hardware_stamps: file with the driver's option `hwtimestamps`.
    """
    exposure_ns = round(exposure_us * 1e3)
    half_readout_ns = round(0.5e9 * abs(config.calibration.line_time_s) * (config.height - 1))
    monotonic = flags & abi.TIMESTAMP_MASK == abi.TIMESTAMP_MONOTONIC
    at_start = monotonic and flags & abi.STAMP_SOURCE_MASK == abi.STAMP_START_OF_EXPOSURE
    rows_ns = half_readout_ns if at_start else -half_readout_ns
    if "timestamp_at" in config.model_fields_set:
        return StampedInstant(monotonic, rows_ns, "" if monotonic else _arrival_text(config))
    if not monotonic:
        return StampedInstant(False, rows_ns - exposure_ns, _arrival_text(config))
    period_ms = 1e3 / config.frame_rate_hz
    if not at_start:
        return StampedInstant(
            True,
            rows_ns - exposure_ns,
            f"camera {config.address}: its driver stamps the end of the transfer: frame times may be up to "
            f"{period_ms:.2g} ms late, all by the same time",
        )
    if driver == UVC_DRIVER and not _is_on(hardware_stamps):
        return StampedInstant(
            True,
            rows_ns - exposure_ns,
            f"camera {config.address}: its driver stamps the first packet of an image: frame times may be up "
            f"to {period_ms:.2g} ms late, all by the same time",
        )
    return StampedInstant(True, rows_ns, "")


def _arrival_text(config: CameraConfig) -> str:
    return (
        f"camera {config.address}: its driver does not stamp images by the monotonic clock: frame times come "
        "from their arrival"
    )


def _is_on(option: Path) -> bool:
    try:
        return option.read_text(encoding="ascii").strip() not in {"0", "N"}
    except OSError:
        return False
