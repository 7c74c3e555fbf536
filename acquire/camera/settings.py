"""Settings of a camera (size, exposure, gain, trigger ...) that are written, read back and compared."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from acquire.camera.aravis_library import aravis_and_glib, reason
from acquire.errors import CameraSettingError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from schemas.rig import CameraConfig


@dataclass(frozen=True)
class Setting:
    """One setting of a camera: wanted value, tolerance, unit, and functions to write and read it."""

    name: str
    """name in messages; that of the GenICam feature if the setting is written as a feature"""
    wanted: float | str
    """value to write"""
    tolerance: float
    """largest permitted difference between the wanted number and the one read back, in `unit`"""
    unit: str
    """unit of the value, for messages; empty if there is none"""
    write: Callable[[Any], object]
    """writes a value to the camera"""
    read: Callable[[], float | str]
    """reads the value from the camera"""

    def agrees(self, got: float | str) -> bool:
        """True if `got`, the value read back, is the wanted one: text exactly, a number within tolerance."""
        if isinstance(self.wanted, str) or isinstance(got, str):
            return self.wanted == got
        return abs(got - self.wanted) <= self.tolerance

    def text(self, value: float | str) -> str:
        """Text for messages of a value of this setting: a text as it is, a number with the unit."""
        return value if isinstance(value, str) else f"{value:g} {self.unit}"


def write_settings(camera: Any, config: CameraConfig) -> None:
    """Write every setting of the rig file to a camera, read it back and compare.

    Range checks are switched on; automatic exposure and gain are switched off.

    Args:
        camera: the opened Aravis camera.
        config: section `camera` of the rig file.

    Raises:
        CameraSettingError: a setting reads back differently, or is out of the camera's range.
        GLib.Error: the camera stopped answering, or refused the modes that precede the settings.
    """
    Aravis, GLib = aravis_and_glib()
    # Off by default, and then Width = 5000 is accepted (Aravis #562).
    camera.set_range_check_policy(Aravis.RangeCheckPolicy.ENABLE)
    camera.set_acquisition_mode(Aravis.AcquisitionMode.CONTINUOUS)
    if camera.is_exposure_auto_available():
        camera.set_exposure_time_auto(Aravis.Auto.OFF)
    if camera.is_gain_auto_available():
        camera.set_gain_auto(Aravis.Auto.OFF)
    for setting in _settings(camera, config):
        wanted = f"camera {config.address}: {setting.name} = {setting.text(setting.wanted)}"
        try:
            setting.write(setting.wanted)
            got = setting.read()
        except GLib.Error as error:
            if error.matches(Aravis.device_error_quark(), Aravis.DeviceError.TIMEOUT):
                raise  # the camera did not refuse, it stopped answering
            raise CameraSettingError(
                f"{wanted} was refused ({reason(error)}): correct the rig file"
            ) from None
        if not setting.agrees(got):
            raise CameraSettingError(
                f"{wanted} was written, {setting.text(got)} read back: correct the rig file"
            )


def _settings(camera: Any, config: CameraConfig) -> Iterator[Setting]:
    """Yield the settings (value, tolerance, how to write and read it) of the rig file's camera section.

    Their order is one that no camera refuses. Nothing is written to the camera here.

    Args:
        camera: the opened Aravis camera.
        config: section `camera` of the rig file.
    """
    # Offsets to 0 first, then the size, then the offsets: each limits the other (Aravis #256).
    region = [
        ("Width", config.width),
        ("Height", config.height),
        ("OffsetX", config.offset_x),
        ("OffsetY", config.offset_y),
    ]
    movable = [(name, 0) for name in ("OffsetX", "OffsetY") if camera.is_feature_available(name)]
    for name, wanted in movable + [(name, wanted) for name, wanted in region if wanted]:
        yield _integer(camera, name, wanted)
    yield _name(camera, "PixelFormat", config.pixel_format)
    # Exposures come in steps of the sensor's line time.
    exposure_step_us = max(20.0, 0.01 * config.exposure_us)
    yield Setting(
        "exposure",
        config.exposure_us,
        exposure_step_us,
        "us",
        camera.set_exposure_time,
        camera.get_exposure_time,
    )
    yield Setting("gain", config.gain_db, 0.1, "dB", camera.set_gain, camera.get_gain)
    yield from _timing_settings(camera, config)
    yield Setting(
        "packet size",
        config.packet_size,
        0.0,
        "B",
        lambda value: camera.gv_set_packet_size(int(value)),
        camera.gv_get_packet_size,
    )


def _timing_settings(camera: Any, config: CameraConfig) -> Iterator[Setting]:
    """Yield the settings of trigger and, without a trigger, of the frame rate, in the order of writing.

    TriggerMode is written on every camera that has it, even if no trigger is used: a camera that keeps its
    settings may otherwise wait for pulses that never arrive.

    Args:
        camera: the opened Aravis camera.
        config: section `camera` of the rig file.
    """
    has_trigger = camera.is_feature_available("TriggerMode")
    if has_trigger or config.trigger != "off":
        if camera.is_feature_available("TriggerSelector"):
            yield _name(camera, "TriggerSelector", "FrameStart")
        yield _name(camera, "TriggerMode", "Off")
    if config.trigger == "off":
        rate_step_hz = 0.001 * config.frame_rate_hz
        yield Setting(
            "frame rate",
            config.frame_rate_hz,
            rate_step_hz,
            "Hz",
            camera.set_frame_rate,
            camera.get_frame_rate,
        )
        return
    # Source and edge are set while the trigger is off, so that no half-configured camera counts pulses.
    # Aravis's set_frame_rate would turn the trigger off.
    yield _name(camera, "TriggerSource", config.trigger)
    yield _name(camera, "TriggerActivation", "RisingEdge")
    yield _name(camera, "TriggerMode", "On")


def _name(camera: Any, name: str, wanted: str) -> Setting:
    return Setting(
        name, wanted, 0.0, "", lambda value: camera.set_string(name, value), lambda: camera.get_string(name)
    )


def _integer(camera: Any, name: str, wanted: int) -> Setting:
    return Setting(
        name,
        wanted,
        0.0,
        "px",
        lambda value: camera.set_integer(name, int(value)),
        lambda: camera.get_integer(name),
    )
