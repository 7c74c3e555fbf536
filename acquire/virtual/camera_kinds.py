"""Virtual cameras, by the kind of camera in the rig file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from acquire.virtual.gige_camera import SENSOR_HEIGHT, SENSOR_WIDTH, VirtualGigeCamera
from acquire.virtual.video_camera import NAME, VirtualVideoCamera

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable

    from acquire.clock.clock import Clock
    from acquire.virtual.image_source import ImageSource

VirtualCamera = VirtualGigeCamera | VirtualVideoCamera


def _gige(source: ImageSource, arguments: argparse.Namespace, clock: Clock) -> VirtualGigeCamera:
    return VirtualGigeCamera(
        arguments.address,
        f"VIRTUAL-{arguments.seed}",
        source,
        clock,
        packet_loss=arguments.packet_loss,
        seed=arguments.seed,
    )


def _v4l2(source: ImageSource, arguments: argparse.Namespace, clock: Clock) -> VirtualVideoCamera:
    camera = VirtualVideoCamera(SENSOR_WIDTH, SENSOR_HEIGHT, source, clock)
    camera.link(arguments.dir / NAME)
    return camera


VIRTUAL_CAMERAS: dict[str, Callable[[ImageSource, argparse.Namespace, Clock], VirtualCamera]] = {
    "gige": _gige,
    "v4l2": _v4l2,
}
"""constructor of the virtual camera, by the kind in the rig file; its arguments are the image source, the
camera process's command line, and the host's clock"""
