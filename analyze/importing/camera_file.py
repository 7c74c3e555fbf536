"""The camera that filmed: its lens and, where the file says it, its place in W."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from analyze.calibrate import read_rig
from analyze.importing.calibrations import SUFFIXES, read_calibration
from schemas.session_manifest import CameraCalibrationSpec


@dataclass(frozen=True)
class CameraFile:
    """What a camera file says."""

    path: Path
    calibration: CameraCalibrationSpec
    """its T_world_camera is the unit matrix where the file has none"""
    placed: bool
    """the file says where the camera stands"""


def read_camera(path: Path) -> CameraFile:
    """A rig file, what `analyze calibrate -o` wrote, or a calibration of OpenCV, Kalibr or ROS (YAML, JSON).

    Raises:
        CalibrationError: the file is missing, not valid, or holds no lens of a kind that is read.
        DocumentError: it holds an entry that cannot be used.
    """
    if path.suffix.lower() in SUFFIXES:
        return CameraFile(path, *read_calibration(path))
    rig, place = read_rig(path)
    return CameraFile(path, rig.camera.calibration, place is not None)
