"""Check of a USB camera's bandwidth: what its images need against the speed of its port."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from acquire.preflight.check import Check, Measured, failed_check, passed_check, skipped_check
from schemas.camera_kind import BYTES_PER_PIXEL

if TYPE_CHECKING:
    from schemas.rig import CameraConfig

VIDEO_DEVICES: Final = Path("/sys/class/video4linux")
USB_DEVICES: Final = Path("/sys/bus/usb/devices")
USABLE_BYTES_S: Final = {480: 24.5e6, 5000: 380e6, 10000: 760e6}
"""usable bytes per second by the port's speed [Mbit/s]: of USB 2 the three packets of 1024 bytes in each of
8000 microframes that a camera may reserve (USB 2.0, 5.6.4); of USB 3 what cameras reach (380 MB/s)"""


def check_usb_bandwidth(
    camera: CameraConfig, video_devices: Path = VIDEO_DEVICES, usb_devices: Path = USB_DEVICES
) -> Check:
    """Check that the port carries the images at the frame rate of the rig file.

    Args:
        camera: section `camera` of the rig file.
        video_devices: the system's folder of video devices.
        usb_devices: the system's folder of USB devices.

    Returns:
        Result of the check: outcome, finding, and a remedy if it failed.
    """
    speed = _port_speed(camera, video_devices, usb_devices)
    needed = camera.width * camera.height * BYTES_PER_PIXEL[camera.pixel_format] * camera.frame_rate_hz
    images = f"images need {needed * 1e-6:.0f} MB/s"
    if speed is None:
        return skipped_check("USB bandwidth", f"{images}; the speed of the camera's port is not known")
    usable = USABLE_BYTES_S.get(speed, 0.05e6 * speed)
    found = f"{images}, a port of {speed} Mbit/s carries {usable * 1e-6:.0f} MB/s"
    measured = Measured(needed, usable, "B/s")
    if needed > usable:
        remedy = (
            'use a USB 3 port if the camera has USB 3, a lower frame_rate_hz, or pixel_format = "MJPG"'
            if "MJPG" in camera.traits.pixel_formats
            else "use a USB 3 port and cable (blue), a smaller image or a lower frame_rate_hz"
        )
        return failed_check("USB bandwidth", found, remedy, measured)
    return passed_check("USB bandwidth", found, measured)


def _port_speed(camera: CameraConfig, video_devices: Path, usb_devices: Path) -> int | None:
    """Speed of the port at which the camera is [Mbit/s]; None if it is not found, or is not on USB.

    A video device is found by its name, a USB3 Vision camera by the serial number that ends its device id.
    """
    name = Path(camera.address).resolve().name
    candidates = [video_devices / name / "device" / ".."]
    for serial in usb_devices.glob("*/serial"):
        number = _read(serial)
        if number and camera.address.endswith(number):
            candidates.append(serial.parent)
    for folder in candidates:
        speed = _read(folder / "speed")
        if speed.isdecimal():
            return int(speed)
    return None


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8").strip()
    except OSError:
        return ""
