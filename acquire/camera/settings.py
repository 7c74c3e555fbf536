"""What is written to a camera, read back and compared. Knows GenICam's names, not Aravis's types: the camera is passed in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from acquire.config import CameraConfig


@dataclass(frozen=True)
class Setting:
    """One thing to write, read back and compare."""

    name: str
    wanted: float | str
    tolerance: float
    """of a number"""
    unit: str
    write: Callable[[Any], object]
    read: Callable[[], float | str]

    def agrees(self, got: float | str) -> bool:
        """Whether what was read back is what was wanted."""
        if isinstance(self.wanted, str) or isinstance(got, str):
            return self.wanted == got
        return abs(got - self.wanted) <= self.tolerance

    def text(self, value: float | str) -> str:
        """A value of this setting for people."""
        return value if isinstance(value, str) else f"{value:g} {self.unit}"


def settings_of(camera: Any, config: CameraConfig) -> Iterator[Setting]:
    """The settings of `config` for an Aravis camera, in an order that no camera refuses."""
    # Offsets to 0 first, then the size, then the offsets: each limits the other (Aravis #256).
    region = [("Width", config.width), ("Height", config.height), ("OffsetX", config.offset_x), ("OffsetY", config.offset_y)]
    movable = [(name, 0) for name in ("OffsetX", "OffsetY") if camera.is_feature_available(name)]
    for name, wanted in movable + [(name, wanted) for name, wanted in region if wanted]:
        yield _integer(camera, name, wanted)
    yield _name(camera, "PixelFormat", config.pixel_format)
    # Exposures come in steps of the sensor's line time.
    exposure_step_us = max(20.0, 0.01 * config.exposure_us)
    yield Setting("exposure", config.exposure_us, exposure_step_us, "us", camera.set_exposure_time, camera.get_exposure_time)
    yield Setting("gain", config.gain_db, 0.1, "dB", camera.set_gain, camera.get_gain)
    yield from _timing_of(camera, config)
    yield Setting(
        "packet size", config.packet_size, 0.0, "B", lambda value: camera.gv_set_packet_size(int(value)), camera.gv_get_packet_size
    )


def _timing_of(camera: Any, config: CameraConfig) -> Iterator[Setting]:
    """When a frame is exposed. TriggerMode is always written: a camera that keeps its settings may wait for pulses that never come."""
    has_trigger = camera.is_feature_available("TriggerMode")
    if has_trigger or config.trigger != "off":
        if camera.is_feature_available("TriggerSelector"):
            yield _name(camera, "TriggerSelector", "FrameStart")
        yield _name(camera, "TriggerMode", "Off")
    if config.trigger == "off":
        rate_step_hz = 0.001 * config.frame_rate_hz
        yield Setting("frame rate", config.frame_rate_hz, rate_step_hz, "Hz", camera.set_frame_rate, camera.get_frame_rate)
        return
    # Source and edge while the trigger is off, so that no half-set camera counts pulses. Aravis's set_frame_rate would turn it off.
    yield _name(camera, "TriggerSource", config.trigger)
    yield _name(camera, "TriggerActivation", "RisingEdge")
    yield _name(camera, "TriggerMode", "On")


def _name(camera: Any, name: str, wanted: str) -> Setting:
    return Setting(name, wanted, 0.0, "", lambda value: camera.set_string(name, value), lambda: camera.get_string(name))


def _integer(camera: Any, name: str, wanted: int) -> Setting:
    return Setting(name, wanted, 0.0, "px", lambda value: camera.set_integer(name, int(value)), lambda: camera.get_integer(name))
