"""Reads camera files: the lens of imported images and, if the file has it, the camera's pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analyze.cameras.board_images import VIDEOS
from analyze.cameras.rig_file import read_rig
from analyze.errors import CalibrationError, ImportRefused
from analyze.sources.foreign_calibrations import SUFFIXES, read_calibration
from analyze.sources.image_file import IMAGE_SUFFIXES
from analyze.sources.source import FrameSource
from analyze.sources.topic_source import TopicSource
from schemas.rig import RigConfig
from schemas.session_manifest import CameraCalibrationSpec

UNREAD_SUFFIXES = (".xml", ".txt", ".ini", ".npz", ".mat")
"""suffixes of other programs' calibration files that are refused"""


@dataclass(frozen=True)
class CameraFile:
    """Calibration of a camera (lens and, if stated, pose) with its origin: a file or a message topic.

    The pose is that in the world frame; `placed` is False if none is stated. A rig file's rig is kept, too.
    """

    path: Path
    """origin of the calibration: a file, or FILE:TOPIC, which is no path of a file"""
    calibration: CameraCalibrationSpec
    """lens and pose; T_world_camera (pose in the world frame) is the unit matrix if the file has none"""
    placed: bool
    """True if the file has T_world_camera"""
    rig: RigConfig | None = None
    """the rig, for its gravity and table; None if it is not a rig file"""
    of_topic: bool = False
    """True if the calibration comes from a topic of a source"""

    @property
    def file_name(self) -> str:
        """File name under which the calibration is attached to a recording.

        It is the camera file's name; for a calibration from a topic, the part of the topic after its last
        slash, with .json added (/cam0/camera_info: camera_info.json).
        """
        return f"{self.path.name}.json" if self.of_topic else self.path.name

    def content(self) -> bytes:
        """Bytes of the calibration as they are attached to a recording.

        They are the camera file, read anew, or a topic's calibration as JSON, without the pose.

        Raises:
            OSError: the file cannot be read any more.
        """
        return (
            self.calibration.model_dump_json(exclude={"T_world_camera"}).encode()
            if self.of_topic
            else self.path.read_bytes()
        )


def read_camera(path: Path) -> CameraFile:
    """Read a camera file: the lens and, if the file has it, the camera's pose in the world frame.

    It may be a rig file, a file of `analyze calibrate -o`, or a calibration of OpenCV, Kalibr or ROS.

    Returns:
        Lens and pose, with the path. Without a pose in the file T_world_camera is the unit matrix and
        `placed` False. `rig` is the whole rig file; None for other files.

    Raises:
        CalibrationError: the file is missing, an image or video, of a type that is not read, not valid, or
            contains no lens of a known model.
        DocumentError: an entry has a value that is not allowed.
    """
    if not path.exists():
        raise CalibrationError(
            f"{path}: no such camera file: check the path, or make one with `analyze calibrate VIEWS -o "
            f"{path.name}`"
        )
    if path.suffix.lower() in {*IMAGE_SUFFIXES, *VIDEOS}:
        raise CalibrationError(
            f"{path}: is an image, not a camera file: make one from 15 views with `analyze calibrate "
            f"{path.name} -o camera.toml`"
        )
    if path.suffix.lower() in SUFFIXES:
        return CameraFile(path, *read_calibration(path))
    if path.suffix.lower() in UNREAD_SUFFIXES:
        raise CalibrationError(
            f"{path}: {path.suffix} is not read: save the calibration as YAML or JSON, or give what `analyze "
            "calibrate -o` wrote"
        )
    rig, place = read_rig(path)
    return CameraFile(path, rig.camera.calibration, place is not None, rig)


def camera_of(sources: Sequence[FrameSource]) -> CameraFile:
    """Read the camera's lens from calibration topics in the sources of its images.

    Args:
        sources: opened sources of images, at least one; only message files can have a calibration.

    Returns:
        The calibration, without the camera's pose.

    Raises:
        ImportRefused: the sources state no calibration, or different ones.
        CalibrationError, DocumentError: a calibration is damaged, or its lens cannot be used.
    """
    calibrations = [(source, source.calibration()) for source in sources if isinstance(source, TopicSource)]
    found = [
        CameraFile(Path(f"{source.path}:{topic[1]}"), topic[0], placed=False, of_topic=True)
        for source, topic in calibrations
        if topic is not None
    ]
    if not found:
        raise ImportRefused(
            f"{sources[0].name}: its lens is unknown: give --camera with a file of `analyze calibrate -o`"
        )
    for other in found[1:]:
        if other.calibration != found[0].calibration:
            raise ImportRefused(
                f"{other.path}: its lens differs from that of {found[0].path}: import images of one camera, "
                "or give --camera"
            )
    return found[0]
