"""Virtual cameras, by the kind of camera in the rig file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from acquire.virtual.camera_makes import MAKES
from acquire.virtual.gige_camera import SENSOR_HEIGHT, SENSOR_WIDTH, VirtualGigeCamera
from acquire.virtual.gige_faults import USUAL, CameraHabits
from acquire.virtual.usb3_camera import VirtualUsb3Camera
from acquire.virtual.usb3_features import usb3_serial
from acquire.virtual.usb_library import FOLDER, compile_library
from acquire.virtual.video_camera import NAME, VirtualVideoCamera

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from acquire.clock.clock import Clock
    from acquire.virtual.image_source import ImageSource

VirtualCamera = VirtualGigeCamera | VirtualUsb3Camera | VirtualVideoCamera


def _gige(source: ImageSource, arguments: argparse.Namespace, clock: Clock) -> VirtualGigeCamera:
    return VirtualGigeCamera(
        arguments.address,
        f"VIRTUAL-{arguments.seed}",
        source,
        clock,
        packet_loss=arguments.packet_loss,
        seed=arguments.seed,
        habits=USUAL if arguments.make is None else CameraHabits(make=MAKES[arguments.make]),
    )


def _v4l2(source: ImageSource, arguments: argparse.Namespace, clock: Clock) -> VirtualVideoCamera:
    camera = VirtualVideoCamera(SENSOR_WIDTH, SENSOR_HEIGHT, source, clock)
    camera.link(arguments.dir / NAME)
    return camera


def _usb3(source: ImageSource, arguments: argparse.Namespace, clock: Clock) -> VirtualUsb3Camera:
    folder, size = arguments.dir / FOLDER, (SENSOR_WIDTH, SENSOR_HEIGHT)
    compile_library(folder)
    return VirtualUsb3Camera(folder, usb3_serial(arguments.seed), size, source, clock)


VIRTUAL_CAMERAS: dict[str, Callable[[ImageSource, argparse.Namespace, Clock], VirtualCamera]] = {
    "gige": _gige,
    "usb3": _usb3,
    "v4l2": _v4l2,
}
"""constructor of the virtual camera, by the kind in the rig file; its arguments are the image source, the
camera process's command line, and the host's clock"""
