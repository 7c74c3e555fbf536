"""Settings of a V4L2 camera: written, read back and compared; everything automatic is switched off."""

from __future__ import annotations

import errno
from dataclasses import dataclass
from typing import TYPE_CHECKING

from acquire.camera import v4l2_abi as abi
from acquire.errors import CameraError, CameraSettingError

if TYPE_CHECKING:
    from acquire.camera.v4l2_device import V4l2Device
    from schemas.camera_kind import PixelFormatName
    from schemas.rig import CameraConfig

CODES: dict[PixelFormatName, str] = {"Mono8": "GREY", "YUYV": "YUYV", "MJPG": "MJPG"}
"""four-letter code of each pixel format of the rig file"""
AUTOMATIC = (
    (abi.CID_EXPOSURE_AUTO, abi.EXPOSURE_MANUAL, "automatic exposure"),
    (abi.CID_EXPOSURE_AUTO_PRIORITY, 0, "a frame rate that falls in the dark"),
    (abi.CID_AUTOGAIN, 0, "automatic gain"),
    (abi.CID_AUTO_WHITE_BALANCE, 0, "automatic white balance"),
    (abi.CID_BACKLIGHT_COMPENSATION, 0, "backlight compensation"),
    (abi.CID_FOCUS_AUTO, 0, "automatic focus"),
    (abi.CID_HFLIP, 0, "a mirrored image"),
    (abi.CID_VFLIP, 0, "an image upside down"),
)
"""controls that change images by themselves or turn them, the value that switches each off, and its effect; a
camera keeps what another program set. The exposure can be written only once its automatic is off."""


@dataclass(frozen=True)
class StreamFormat:
    """Images as the driver delivers them, and what was read back of exposure and frame rate."""

    code: str
    """four-letter code of the pixel format"""
    row_bytes: int
    """bytes from a row to the next; 0 for compressed images"""
    exposure_us: float
    """exposure time [us]"""
    frame_rate_hz: float
    """frame rate [Hz]"""


def write_v4l2_settings(device: V4l2Device, config: CameraConfig) -> StreamFormat:
    """Write every setting of the rig file to an open device, read it back and compare.

    Args:
        device: the open device, which does not stream.
        config: section `camera` of the rig file.

    Returns:
        The images' format, with exposure and frame rate as read back.

    Raises:
        CameraSettingError: a setting is refused or reads back differently.
        CameraError: another program uses the camera.
        OSError: the camera is gone.
    """
    row_bytes = _write_format(device, config)
    rate_hz = _write_frame_rate(device, config)
    for control, off, effect in AUTOMATIC:
        _switch_off(device, config, control, off, effect)
    exposure_us = _write_exposure(device, config)
    _write_gain(device, config)
    return StreamFormat(CODES[config.pixel_format], row_bytes, exposure_us, rate_hz)


def _write_format(device: V4l2Device, config: CameraConfig) -> int:
    """Write size and pixel format; return the bytes from a row to the next."""
    code = CODES[config.pixel_format]
    asked = abi.ImageFormat(
        type=abi.VIDEO_CAPTURE,
        width=config.width,
        height=config.height,
        pixelformat=abi.fourcc(code),
        field=abi.FIELD_NONE,
    )
    try:
        got = device.request(abi.S_FMT, asked)
    except OSError as error:
        if error.errno == errno.EBUSY:
            raise busy(config.address) from None
        if error.errno != errno.EINVAL:
            raise
        got = abi.ImageFormat()
    found = abi.fourcc_name(got.pixelformat)
    if found != code:
        formats = device.formats()
        usable = [name for name, known in CODES.items() if known in formats]
        remedy = f'write pixel_format = "{usable[0]}"' if usable else "use another camera"
        raise CameraSettingError(
            f"camera {config.address}: pixel format {code} is not offered, but {', '.join(formats) or 'none'}"
            f": {remedy}"
        )
    if (got.width, got.height) != (config.width, config.height):
        raise CameraSettingError(
            f"camera {config.address}: {config.width} x {config.height} px were written, "
            f"{got.width} x {got.height} read back: write a size that the camera has in the rig file "
            f"(`v4l2-ctl --list-formats-ext` lists them), and calibrate at that size"
        )
    return 0 if code == "MJPG" else int(got.bytesperline)


def _write_frame_rate(device: V4l2Device, config: CameraConfig) -> float:
    """Write the frame rate; return it as read back [Hz]."""
    asked = abi.StreamParameters(
        type=abi.VIDEO_CAPTURE, numerator=1000, denominator=round(1000 * config.frame_rate_hz)
    )
    try:
        device.request(abi.S_PARM, asked)
        got = device.request(abi.G_PARM, abi.StreamParameters(type=abi.VIDEO_CAPTURE))
    except OSError as error:
        if error.errno not in {errno.EINVAL, errno.ENOTTY}:
            raise
        raise CameraSettingError(
            f"camera {config.address} has no frame rate that can be set: its driver must offer it; "
            "use another camera"
        ) from None
    rate_hz = got.denominator / got.numerator if got.numerator else 0.0
    if abs(rate_hz - config.frame_rate_hz) > 0.001 * config.frame_rate_hz:
        raise CameraSettingError(
            f"camera {config.address}: frame rate = {config.frame_rate_hz:g} Hz was written, {rate_hz:g} Hz "
            "read back: write a rate that the camera has at this size and pixel format in the rig file"
        )
    return rate_hz


def _switch_off(device: V4l2Device, config: CameraConfig, control: int, off: int, effect: str) -> None:
    """Write the value `off` to a control that has an automatic or mirroring effect, if it has not that value.

    Cameras without the control have no such effect.
    """
    if device.control_range(control) is None or device.control(control) == off:
        return
    try:
        device.set_control(control, off)
        stays = device.control(control) != off
    except OSError as error:
        if error.errno == errno.EBUSY:
            raise busy(config.address) from None
        if error.errno not in {errno.EINVAL, errno.ERANGE, errno.EACCES, errno.EIO, errno.EPIPE}:
            raise
        stays = True
    if stays:
        raise CameraSettingError(
            f"camera {config.address}: {effect} cannot be switched off: use another camera"
        )


def _write_exposure(device: V4l2Device, config: CameraConfig) -> float:
    """Write the exposure; return it as read back [us]."""
    known = device.control_range(abi.CID_EXPOSURE_ABSOLUTE)
    if known is None:
        in_lines = device.control_range(abi.CID_EXPOSURE) is not None
        reason = "counts its exposure in lines of the sensor" if in_lines else "has no exposure to set"
        raise CameraSettingError(
            f"camera {config.address} {reason}: its images have no known time; use another camera"
        )
    unit_us = abi.EXPOSURE_UNIT_US
    steps = round(config.exposure_us / unit_us)
    if not known.minimum <= steps <= known.maximum:
        raise CameraSettingError(
            f"camera {config.address}: exposure = {config.exposure_us:g} us is outside its range, "
            f"{known.minimum * unit_us:g} to {known.maximum * unit_us:g} us: correct exposure_us in the rig "
            "file"
        )
    device.set_control(abi.CID_EXPOSURE_ABSOLUTE, steps)
    got_us = device.control(abi.CID_EXPOSURE_ABSOLUTE) * unit_us
    if abs(got_us - config.exposure_us) > 0.5 * unit_us + 0.01 * config.exposure_us:
        raise CameraSettingError(
            f"camera {config.address}: exposure = {config.exposure_us:g} us was written, {got_us:g} us read "
            "back: correct exposure_us in the rig file"
        )
    return got_us


def _write_gain(device: V4l2Device, config: CameraConfig) -> None:
    """Write the gain: the lowest one, or the steps in the rig file."""
    known = device.control_range(abi.CID_GAIN)
    low, high = (0, 0) if known is None else (known.minimum, known.maximum)
    if config.gain_db is not None:
        raise CameraSettingError(
            f"camera {config.address} counts its gain in steps, {low} to {high}: write gain_raw = {low} in "
            "the rig file, or leave the gain out for the lowest"
        )
    wanted = low if config.gain_raw is None else config.gain_raw
    if not low <= wanted <= high:
        raise CameraSettingError(
            f"camera {config.address}: gain = {wanted} steps is outside its range, {low} to {high}: correct "
            "gain_raw in the rig file"
        )
    if known is None:
        return
    device.set_control(abi.CID_GAIN, wanted)
    if (got := device.control(abi.CID_GAIN)) != wanted:
        raise CameraSettingError(
            f"camera {config.address}: gain = {wanted} steps was written, {got} read back: correct gain_raw "
            "in the rig file"
        )


def busy(path: str) -> CameraError:
    """Exception for a camera that another program uses."""
    return CameraError(f"camera {path} is used by another program: close that program, then try again")
