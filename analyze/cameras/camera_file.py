"""The camera that filmed: its lens and, where the file says it, its place in W."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analyze.cameras.board_images import SUFFIXES as PICTURES
from analyze.cameras.board_images import VIDEOS
from analyze.cameras.calibrate import read_rig
from analyze.cameras.foreign_calibrations import SUFFIXES, read_calibration
from analyze.errors import CalibrationError, ImportRefused
from analyze.sources.source import FrameSource
from analyze.sources.topic_source import TopicSource
from schemas.rig import RigConfig
from schemas.session_manifest import CameraCalibrationSpec

_OF_OTHERS = (".xml", ".txt", ".ini", ".npz", ".mat")
"""files in which other programs keep calibrations too"""


@dataclass(frozen=True)
class CameraFile:
    """What a camera file says."""

    path: Path
    """where it is said: a file, or a file and its topic"""
    calibration: CameraCalibrationSpec
    """its T_world_camera is the unit matrix where the file has none"""
    placed: bool
    """the file says where the camera stands"""
    rig: RigConfig | None = None
    """what it says of gravity and the table besides, where it is a rig file"""
    of_topic: bool = False
    """said by a topic of a source"""

    @property
    def file_name(self) -> str:
        """What its content is called as a file."""
        return f"{self.path.name}.json" if self.of_topic else self.path.name

    def content(self) -> bytes:
        """As the file has it; of a topic what was understood of it."""
        return self.calibration.model_dump_json(exclude={"T_world_camera"}).encode() if self.of_topic else self.path.read_bytes()


def read_camera(path: Path) -> CameraFile:
    """A rig file, what `analyze calibrate -o` wrote, or a calibration of OpenCV, Kalibr or ROS (YAML, JSON).

    Raises:
        CalibrationError: the file is missing, not valid, or holds no lens of a kind that is read.
        DocumentError: it holds an entry that cannot be used.
    """
    if not path.exists():
        raise CalibrationError(f"{path}: no such camera file: check the path; `analyze calibrate VIEWS -o {path.name}` makes one")
    if path.suffix.lower() in {*PICTURES, *VIDEOS}:
        raise CalibrationError(f"{path}: is a view, no camera file: `analyze calibrate {path.name} -o camera.toml` makes one of 15 views")
    if path.suffix.lower() in SUFFIXES:
        return CameraFile(path, *read_calibration(path))
    if path.suffix.lower() in _OF_OTHERS:
        raise CalibrationError(
            f"{path}: {path.suffix} is not read: save the calibration as YAML or JSON, or give what `analyze calibrate -o` wrote"
        )
    rig, place = read_rig(path)
    return CameraFile(path, rig.camera.calibration, place is not None, rig)


def camera_of(sources: Sequence[FrameSource]) -> CameraFile:
    """The lens as the sources' own files say it.

    Raises:
        ImportRefused: they do not, or disagree.
        CalibrationError, DocumentError: it is of a kind that is not read.
    """
    said = [(source, source.calibration()) for source in sources if isinstance(source, TopicSource)]
    found = [
        CameraFile(Path(f"{source.path}:{topic[1]}"), topic[0], placed=False, of_topic=True) for source, topic in said if topic is not None
    ]
    if not found:
        raise ImportRefused(f"{sources[0].name}: nothing says what lens took it: give --camera, which `analyze calibrate -o` writes")
    for other in found[1:]:
        if other.calibration != found[0].calibration:
            raise ImportRefused(f"{other.path}: says another lens than {found[0].path}: import what one camera took, or give --camera")
    return found[0]
