"""Search for cameras among the video devices of this computer."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from acquire.camera import v4l2_abi as abi
from acquire.camera.base import CameraInfo
from acquire.camera.v4l2_device import V4l2Device
from acquire.camera.v4l2_settings import CODES
from acquire.errors import CameraError

DEVICES: Final = Path("/dev")
_BY_ID: Final = "v4l/by-id"


def list_v4l2_cameras(devices: Path = DEVICES) -> list[CameraInfo]:
    """List the video devices that give images in a pixel format that the rig file can name.

    The address of a USB camera is its name in /dev/v4l/by-id where it has one: that stays when other cameras
    come and go. Devices that this user may not open are left out.

    Args:
        devices: folder of device files.

    Returns:
        Identities of the cameras, in the order of their numbers; empty if there is none.
    """
    lasting = {path.resolve(): path for path in sorted((devices / _BY_ID).glob("*"))}
    found: list[CameraInfo] = []
    for path in sorted(devices.glob("video*"), key=lambda path: (len(path.name), path.name)):
        try:
            device = V4l2Device(str(path))
        except CameraError:
            continue
        try:
            given, abilities, formats = device.capability, device.abilities, device.formats()
        finally:
            device.close()
        if abilities & abi.CAP_VIDEO_CAPTURE and abilities & abi.CAP_STREAMING:
            if not set(CODES.values()) & set(formats):
                continue
            driver, card, bus = (
                value.decode("utf-8", "replace") for value in (given.driver, given.card, given.bus_info)
            )
            address = str(lasting.get(path.resolve(), path))
            found.append(CameraInfo(driver, card, bus, address, kind="v4l2"))
    return found
