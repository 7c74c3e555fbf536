"""Kinds and makes of a virtual rig's camera and striker: process arguments, lines of the rig file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from acquire.virtual.camera_makes import MAKES
from acquire.virtual.striker_firmware import FASTEST_MM_S, SLOWEST_MM_S
from acquire.virtual.usb3_features import device_id, usb3_serial
from acquire.virtual.video_camera import NAME as VIDEO_NAME
from schemas.servo_models import DEFAULT_MODEL, ModelName

if TYPE_CHECKING:
    from pathlib import Path

    from schemas.camera_kind import CameraKindName


_STRIKER_LINES: Final = {"serial": f"\nspeed_range_m_s = [{SLOWEST_MM_S / 1000}, {FASTEST_MM_S / 1000}]"}
"""line of section [striker] with the speeds, by kind of striker; none where they follow from the arm"""


@dataclass(frozen=True)
class DeviceKinds:
    """Kinds of camera and striker, with the make of the one and the model of the other."""

    camera: CameraKindName = "gige"
    """kind of camera"""
    make: str | None = None
    """make that a GigE camera takes on, a key of MAKES; None for Aravis's own fake camera"""
    striker: str = "dynamixel"
    """kind of striker: dynamixel or serial"""
    servo: ModelName = DEFAULT_MODEL
    """model of the servo of a dynamixel striker"""

    @property
    def camera_arguments(self) -> list[str]:
        """Command-line arguments of the camera process."""
        return ["--kind", self.camera, *([] if self.make is None else ["--make", self.make])]

    @property
    def world_arguments(self) -> list[str]:
        """Command-line arguments of the world process."""
        return ["--striker", self.striker, "--servo", self.servo]

    @property
    def camera_lines(self) -> str:
        """Lines of section [camera] with kind and stamp; "" for a GigE camera that stamps the start.

        Those are the defaults of rig files.
        """
        lines = "" if self.camera == "gige" else f'\nkind = "{self.camera}"'
        if self.camera == "v4l2":
            return f'{lines}\ntimestamp_at = "exposure_start"'
        if self.make is not None and MAKES[self.make].stamp_at != "exposure_start":
            return f'{lines}\ntimestamp_at = "{MAKES[self.make].stamp_at}"'
        return lines

    @property
    def striker_lines(self) -> str:
        """Lines of section [striker] with the servo's model, or a board's speeds; "" if they are defaults."""
        model = "" if self.servo == DEFAULT_MODEL else f'\nmodel = "{self.servo}"'
        return _STRIKER_LINES.get(self.striker, model)

    def camera_address(self, address: str, folder: Path, seed: int) -> str:
        """Address of the camera, as a rig file gives it: IP address, video device or device id.

        Args:
            address: loopback address of a GigE camera.
            folder: folder of the rig's files.
            seed: seed of the rig, which is in the serial number.
        """
        places = {"gige": address, "v4l2": str(folder / VIDEO_NAME), "usb3": device_id(usb3_serial(seed))}
        return places[self.camera]


USUAL_KINDS: Final = DeviceKinds()
"""GigE camera of Aravis's own, and the default servo"""
