"""The camera that filmed: its lens and, where the file says it, its place in W."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from analyze.calibrate import read_rig
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
    """A rig file, or what `analyze calibrate -o` wrote.

    Raises:
        CalibrationError: the file is missing or no TOML.
        DocumentError: it holds an entry that cannot be used.
    """
    rig, place = read_rig(path)
    return CameraFile(path, rig.camera.calibration, place is not None)
