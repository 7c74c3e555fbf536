"""Kinds of camera that a rig file can name, and what follows from the kind for checks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

CameraKindName = Literal["gige", "usb3", "v4l2"]
PixelFormatName = Literal["Mono8", "YUYV", "MJPG"]


@dataclass(frozen=True)
class CameraKind:
    """Properties that all cameras of one kind have in common."""

    description: str
    """noun phrase for messages"""
    on_network: bool
    """True if its images arrive in UDP packets, whose size and receive buffer matter"""
    on_usb: bool
    """True if its images arrive over USB, whose bandwidth matters"""
    can_be_triggered: bool
    """True if pulses at an input line can start its frames"""
    has_offsets: bool
    """True if the region of interest can begin anywhere on the sensor"""
    driver_states_instant: bool
    """True if its driver states which instant of a frame it stamps, as long as the rig file does not"""
    pixel_formats: tuple[PixelFormatName, ...]
    """formats in which it may send images"""


CAMERA_KINDS: dict[CameraKindName, CameraKind] = {
    "gige": CameraKind(
        "a GigE Vision camera",
        on_network=True,
        on_usb=False,
        can_be_triggered=True,
        has_offsets=True,
        driver_states_instant=False,
        pixel_formats=("Mono8",),
    ),
    "usb3": CameraKind(
        "a USB3 Vision camera",
        on_network=False,
        on_usb=True,
        can_be_triggered=True,
        has_offsets=True,
        driver_states_instant=False,
        pixel_formats=("Mono8",),
    ),
    "v4l2": CameraKind(
        "a camera of the kernel's video interface (V4L2)",
        on_network=False,
        on_usb=True,
        can_be_triggered=False,
        has_offsets=False,
        driver_states_instant=True,
        pixel_formats=("Mono8", "YUYV", "MJPG"),
    ),
}
BYTES_PER_PIXEL: dict[PixelFormatName, float] = {"Mono8": 1.0, "YUYV": 2.0, "MJPG": 0.25}
"""bytes of a pixel on the wire; that of MJPG is a usual value, which depends on the image"""
