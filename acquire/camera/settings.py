"""What is written to a camera, read back and compared. Knows GenICam's names, not Aravis's types: the camera is passed in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from acquire.config import CameraConfig

MONO8 = 0x01080001
"""PFNC code of Mono8"""


@dataclass(frozen=True)
class Setting:
    """One thing to write, read back and compare."""

    name: str
    wanted: float
    tolerance: float
    unit: str
    write: Callable[[float], object]
    read: Callable[[], float]


def settings_of(camera: Any, config: CameraConfig) -> Iterator[Setting]:
    """The settings of `config` for an Aravis camera, in an order that no camera refuses."""
    # Offsets to 0 first, then the size, then the offsets: each limits the other (Aravis #256).
    region = [("Width", config.width), ("Height", config.height), ("OffsetX", config.offset_x), ("OffsetY", config.offset_y)]
    movable = [(name, 0) for name in ("OffsetX", "OffsetY") if camera.is_feature_available(name)]
    for name, wanted in movable + [(name, wanted) for name, wanted in region if wanted]:
        yield _integer(camera, name, wanted)
    yield Setting("pixel format", MONO8, 0.0, "(Mono8)", lambda value: camera.set_pixel_format(int(value)), camera.get_pixel_format)
    # Exposures come in steps of the sensor's line time.
    exposure_step_us = max(20.0, 0.01 * config.exposure_us)
    yield Setting("exposure", config.exposure_us, exposure_step_us, "us", camera.set_exposure_time, camera.get_exposure_time)
    yield Setting("gain", config.gain_db, 0.1, "dB", camera.set_gain, camera.get_gain)
    rate_step_hz = 0.001 * config.frame_rate_hz
    yield Setting("frame rate", config.frame_rate_hz, rate_step_hz, "Hz", camera.set_frame_rate, camera.get_frame_rate)
    yield Setting(
        "packet size", config.packet_size, 0.0, "B", lambda value: camera.gv_set_packet_size(int(value)), camera.gv_get_packet_size
    )


def _integer(camera: Any, name: str, wanted: int) -> Setting:
    return Setting(name, wanted, 0.0, "px", lambda value: camera.set_integer(name, int(value)), lambda: camera.get_integer(name))
