"""Choice of the camera's class by the rig file's `camera.kind`: the only place where the kind decides."""

from __future__ import annotations

from typing import TYPE_CHECKING

from acquire.errors import CameraError

if TYPE_CHECKING:
    from collections.abc import Callable

    from acquire.camera.base import Camera, CameraInfo
    from acquire.clock.clock import Clock
    from schemas.camera_kind import CameraKindName
    from schemas.rig import CameraConfig


def make_camera(config: CameraConfig, clock: Clock, borrowable_frames: int = 0) -> Camera:
    """Camera of the kind that the rig file names; it is not opened.

    Args:
        config: section `camera` of the rig file.
        clock: the host's clock.
        borrowable_frames: number of frames whose buffers may be borrowed (kept after the next read) at a
            time.
    """
    return _CLASSES[config.kind](config, clock, borrowable_frames)


def _gige(config: CameraConfig, clock: Clock, borrowable_frames: int) -> Camera:
    from acquire.camera.aravis import AravisCamera

    return AravisCamera(config, clock, borrowable_frames)


def _usb3(config: CameraConfig, clock: Clock, borrowable_frames: int) -> Camera:
    from acquire.camera.aravis import AravisCamera
    from acquire.camera.aravis_link import UsbLink

    return AravisCamera(config, clock, borrowable_frames, UsbLink)


def _v4l2(config: CameraConfig, clock: Clock, borrowable_frames: int) -> Camera:
    from acquire.camera.v4l2 import V4l2Camera

    return V4l2Camera(config, clock, borrowable_frames)


_CLASSES: dict[CameraKindName, Callable[[CameraConfig, Clock, int], Camera]] = {
    "gige": _gige,
    "usb3": _usb3,
    "v4l2": _v4l2,
}
"""constructor of each kind of camera; it imports its library only when it is needed"""


def discover_cameras() -> tuple[list[CameraInfo], list[str]]:
    """Search for cameras of all kinds; takes about a second.

    Returns:
        Identities of the cameras, empty if none answers; and what kept cameras from the list, a line of text
        each: Aravis is missing, or this user may not open a USB3 Vision camera.
    """
    from acquire.camera import aravis_library
    from acquire.camera.usb_access import denied_remedy, denied_usb_cameras
    from acquire.camera.v4l2_discovery import list_v4l2_cameras

    notes: list[str] = []
    found: list[CameraInfo] = []
    try:
        found += aravis_library.discover()
    except CameraError as error:
        notes.append(f"GigE and USB3 Vision cameras were not searched: {error}")
    if denied := denied_usb_cameras():
        notes.append(denied_remedy(denied))
    return found + list_v4l2_cameras(), notes
