"""Settings of a camera (size, exposure, gain, trigger ...) that are written, read back and compared."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from acquire.camera.aravis_library import aravis_and_glib, reason
from acquire.errors import CameraError, CameraSettingError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from schemas.rig import CameraConfig


LIMIT, LIMIT_MODE = "DeviceLinkThroughputLimit", "DeviceLinkThroughputLimitMode"
"""features of a USB camera that limit its bandwidth [bytes/s], by their standard names (SFNC)"""
DEFAULT_REMEDY = "correct the rig file"


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
    remedy: str = DEFAULT_REMEDY
    """what to do if the camera takes another value"""

    def agrees(self, got: float | str) -> bool:
        """True if `got`, the value read back, is the wanted one: text exactly, a number within tolerance."""
        if isinstance(self.wanted, str) or isinstance(got, str):
            return self.wanted == got
        return abs(got - self.wanted) <= self.tolerance

    def text(self, value: float | str) -> str:
        """Text for messages of a value of this setting: a text as it is, a number with the unit."""
        return value if isinstance(value, str) else f"{value:g} {self.unit}"


REMEMBERED: tuple[tuple[str, int | bool | str], ...] = (
    ("BinningHorizontal", 1),
    ("BinningVertical", 1),
    ("DecimationHorizontal", 1),
    ("DecimationVertical", 1),
    ("ReverseX", False),
    ("ReverseY", False),
    ("GammaEnable", False),
    ("ExposureMode", "Timed"),
    ("ChunkModeActive", False),
    ("TestImageSelector", "Off"),
    ("TestPattern", "Off"),
)
"""features that a camera may keep from another program, by their standard names (SFNC), and the values that
images need: whole pixels, the right way round, grey values in proportion to the light, nothing added"""
MAKERS_REMEDY = "set it with the maker's program, and save that as the camera's default"
"""what to do where the rig file has no such setting"""
FRAME_TRIGGERS = ("FrameStart", "FrameBurstStart", "AcquisitionStart")
"""names under which cameras start a frame by a pulse, the usual first (Hikrobot knows only the second, old
Baslers also the third)"""


def write_settings(camera: Any, config: CameraConfig) -> None:
    """Write every setting of the rig file to a camera, read it back and compare.

    A stream that another program left is stopped, its lock of size and packets released, the maker's settings
    are loaded, and what a camera may keep from another program is set: binning, mirroring, gamma, chunks,
    triggers, automatic exposure and gain. Range checks are switched on.

    Args:
        camera: the opened Aravis camera.
        config: section `camera` of the rig file.

    Raises:
        CameraSettingError: a setting reads back differently, or is refused.
        CameraError: the camera denies access.
        GLib.Error: the camera stopped answering.
    """
    Aravis, GLib = aravis_and_glib()
    _try(camera.stop_acquisition)  # a camera refuses its settings while it streams
    # A program that ended in a stream leaves its lock (SFNC), and Aravis does not write this feature.
    if camera.is_feature_available("TLParamsLocked"):
        _try(lambda: camera.set_integer("TLParamsLocked", 0))
    _load_makers_settings(camera)
    # Off by default, and then Width = 5000 is accepted (Aravis #562).
    camera.set_range_check_policy(Aravis.RangeCheckPolicy.ENABLE)
    name = "acquisition mode"
    try:
        camera.set_acquisition_mode(Aravis.AcquisitionMode.CONTINUOUS)
        name = "automatic exposure"
        if camera.is_exposure_auto_available():
            camera.set_exposure_time_auto(Aravis.Auto.OFF)
        name = "automatic gain"
        if camera.is_gain_auto_available():
            camera.set_gain_auto(Aravis.Auto.OFF)
        name = "triggers"
        camera.clear_triggers()
    except GLib.Error as error:
        raise _refusal(f"camera {config.address}: {name}", error, MAKERS_REMEDY) from None
    _lift_bandwidth_limit(camera)
    for setting in _settings(camera, config):
        wanted = f"camera {config.address}: {setting.name} = {setting.text(setting.wanted)}"
        try:
            setting.write(setting.wanted)
            got = setting.read()
        except GLib.Error as error:
            raise _refusal(wanted, error, setting.remedy) from None
        if not setting.agrees(got):
            raise CameraSettingError(f"{wanted} was written, {setting.text(got)} read back: {setting.remedy}")


def _refusal(what: str, error: Any, remedy: str) -> Exception:
    """Exception for a setting that a camera refused; `error` itself if the camera stopped answering.

    Args:
        what: camera and setting, for the message.
        error: GLib.Error of the attempt.
        remedy: what to do if the camera takes no such setting.
    """
    Aravis, _ = aravis_and_glib()
    if _timed_out(error):
        return error
    if error.matches(Aravis.device_error_quark(), Aravis.DeviceError.PROTOCOL_ERROR_ACCESS_DENIED):
        return CameraError(
            f"{what}: the camera denies access: another program controls it; close that program, or switch "
            "the camera off and on"
        )
    return CameraSettingError(f"{what} was refused ({reason(error)}): {remedy}")


def _timed_out(error: Any) -> bool:
    """True if the camera did not refuse, but stopped answering."""
    Aravis, _ = aravis_and_glib()
    return bool(error.matches(Aravis.device_error_quark(), Aravis.DeviceError.TIMEOUT))


def _try(call: Callable[[], Any]) -> Any:
    """Result of a call that a camera may refuse, None then; a time-out is raised."""
    _, GLib = aravis_and_glib()
    try:
        return call()
    except GLib.Error as error:
        if _timed_out(error):
            raise
        return None


def _load_makers_settings(camera: Any) -> None:
    """Load the maker's settings, where the camera has them (SFNC: UserSetSelector, UserSetLoad).

    Not all cameras allow it; what matters is set one by one afterwards.
    """
    if not (camera.is_feature_available("UserSetSelector") and camera.is_feature_available("UserSetLoad")):
        return
    if "Default" in (_try(lambda: camera.dup_available_enumerations_as_strings("UserSetSelector")) or ()):
        _try(lambda: camera.set_string("UserSetSelector", "Default"))
        if _try(lambda: camera.get_string("UserSetSelector")) == "Default":
            _try(lambda: camera.execute_command("UserSetLoad"))


def _lift_bandwidth_limit(camera: Any) -> None:
    """Switch a USB camera's limit of its bandwidth off, or raise it to its greatest value; it may refuse.

    Makers set it low, so that several cameras fit on one bus, and it bounds the frame rate. Aravis's own call
    does this for XIMEA alone (0.8.26, arvcamera.c 3448).
    """
    if not camera.is_uv_device():
        return
    if camera.is_feature_available(LIMIT_MODE):
        _try(lambda: camera.set_string(LIMIT_MODE, "Off"))
    if _bandwidth_limit(camera) is not None:
        _try(lambda: camera.set_integer(LIMIT, camera.get_integer_bounds(LIMIT)[1]))


def _bandwidth_limit(camera: Any) -> int | None:
    """Limit of a USB camera's bandwidth [bytes/s]; None if it has none, or is switched off."""
    if not (camera.is_uv_device() and camera.is_feature_available(LIMIT)):
        return None
    if camera.is_feature_available(LIMIT_MODE) and _try(lambda: camera.get_string(LIMIT_MODE)) == "Off":
        return None
    return _try(lambda: camera.get_integer(LIMIT))


def _rate_remedy(camera: Any, config: CameraConfig) -> str:
    """What to do if the camera does not take the frame rate."""
    limit = _bandwidth_limit(camera)
    if limit is None:
        return DEFAULT_REMEDY
    payload = camera.get_payload()
    if payload * config.frame_rate_hz <= limit:
        return DEFAULT_REMEDY
    return (
        f"the camera limits its images to {limit * 1e-6:.0f} MB/s ({LIMIT}), which are {limit / payload:.0f} "
        "Hz: use a USB 3 port, raise the limit with the maker's program, or lower frame_rate_hz"
    )


def _settings(camera: Any, config: CameraConfig) -> Iterator[Setting]:
    """Yield the settings (value, tolerance, how to write and read it) of the rig file's camera section.

    Their order is one that no camera refuses. Nothing is written to the camera here.

    Args:
        camera: the opened Aravis camera.
        config: section `camera` of the rig file.
    """
    for name, wanted in REMEMBERED:
        if camera.is_feature_available(name) and _try(partial(_reader(camera, wanted), name)) is not None:
            yield _remembered(camera, name, wanted)
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
    yield from _gain(camera, config)
    yield from _timing_settings(camera, config)
    if camera.is_gv_device():
        yield Setting(
            "packet size",
            config.packet_size,
            0.0,
            "B",
            lambda value: camera.gv_set_packet_size(int(value)),
            camera.gv_get_packet_size,
        )


def _gain(camera: Any, config: CameraConfig) -> Iterator[Setting]:
    """Yield the setting of the gain: the lowest one unless the rig file names one, in dB or in steps.

    Raises:
        CameraSettingError: the camera counts its gain in the other unit.
    """
    if not camera.is_gain_available():
        return
    in_steps = not any(camera.is_feature_available(name) for name in ("Gain", "GainAbs"))
    low, high = camera.get_gain_bounds()
    if config.gain_db is None and config.gain_raw is None:
        yield Setting("gain", low, 0.1, "", camera.set_gain, camera.get_gain)
        return
    unit, key = ("steps", "gain_raw") if in_steps else ("dB", "gain_db")
    wanted = config.gain_raw if in_steps else config.gain_db
    if wanted is None:
        raise CameraSettingError(
            f"camera {config.address} counts its gain in {unit}, {low:g} to {high:g}: write {key} = {low:g} "
            "in the rig file, or leave the gain out for the lowest"
        )
    yield Setting("gain", wanted, 0.1, unit, camera.set_gain, camera.get_gain)


def _timing_settings(camera: Any, config: CameraConfig) -> Iterator[Setting]:
    """Yield the settings of trigger or frame rate, in the order of writing; all triggers are off before.

    Args:
        camera: the opened Aravis camera.
        config: section `camera` of the rig file.

    Raises:
        CameraSettingError: the camera has no frame rate to set, or no trigger.
    """
    if config.trigger == "off":
        if not camera.is_frame_rate_available():
            raise CameraSettingError(
                f"camera {config.address} has no frame rate that can be set: trigger it by pulses "
                '(trigger = "Line1" in the rig file)'
            )
        rate_step_hz = 0.001 * config.frame_rate_hz
        yield Setting(
            "frame rate",
            config.frame_rate_hz,
            rate_step_hz,
            "Hz",
            camera.set_frame_rate,
            camera.get_frame_rate,
            _rate_remedy(camera, config),
        )
        return
    # A rate left on holds pulses down; Alvium denies this while a trigger is on (Aravis #879).
    if camera.is_feature_available("AcquisitionFrameRateEnable"):
        yield _remembered(camera, "AcquisitionFrameRateEnable", wanted=False)
    # Source and edge are set while the trigger is off, so that no half-configured camera counts pulses.
    # Aravis's set_frame_rate would turn the trigger off.
    if not camera.is_feature_available("TriggerMode"):
        raise CameraSettingError(
            f'camera {config.address} has no trigger input: write trigger = "off" in the rig file'
        )
    if camera.is_feature_available("TriggerSelector"):
        known = camera.dup_available_enumerations_as_strings("TriggerSelector")
        selector = next((name for name in FRAME_TRIGGERS if name in known), FRAME_TRIGGERS[0])
        yield _name(camera, "TriggerSelector", selector)
    yield _name(camera, "TriggerSource", config.trigger)
    if camera.is_feature_available("TriggerActivation"):
        yield _name(camera, "TriggerActivation", "RisingEdge")
    yield _name(camera, "TriggerMode", "On")


def _remembered(camera: Any, name: str, wanted: int | bool | str) -> Setting:
    """Setting of a feature that is written only where it differs: some are locked at their value."""
    read, write = _reader(camera, wanted), getattr(camera, f"set_{_kind(wanted)}")

    def write_if_different(value: Any) -> None:
        if read(name) != value:
            write(name, value)

    return Setting(name, wanted, 0.0, "", write_if_different, lambda: read(name), MAKERS_REMEDY)


def _reader(camera: Any, wanted: int | bool | str) -> Callable[[str], Any]:
    """Function that reads a feature of the type of `wanted` by its name."""
    return getattr(camera, f"get_{_kind(wanted)}")


def _kind(value: int | bool | str) -> str:
    return "boolean" if isinstance(value, bool) else "string" if isinstance(value, str) else "integer"


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
