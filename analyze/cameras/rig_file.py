"""Reads rig files for the analysis: the camera, its pose, and the level reading (measured table tilt)."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from analyze.errors import CalibrationError
from schemas.document import validate
from schemas.input_file import read_text
from schemas.rig import RigConfig

PLUMB_LINE = "plumb line"
"""value of `read_by` in a level reading (measured table tilt) that `analyze gravity` wrote"""


def read_rig(path: Path) -> tuple[RigConfig, list[list[float]] | None]:
    """Read a rig file (TOML), in which the camera's address and calibration may be missing.

    Missing entries get placeholders: address "none", an image of 1 x 1 px, and unit matrices for K and
    T_world_camera.

    Returns:
        Content of the file, and its T_world_camera (4, 4), the camera's pose in the world frame; None if the
        file has none.

    Raises:
        CalibrationError: the file is missing, cannot be read, is not valid TOML, or is an object file.
        DocumentError: the table [camera] is missing, or an entry has a value that is not allowed.
    """
    try:
        data: dict[str, Any] = tomllib.loads(read_text(path))
    except FileNotFoundError:
        raise CalibrationError(f"{path}: no such rig file: check the path") from None
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise CalibrationError(f"{path}: not valid TOML: {error}") from None
    camera = data.get("camera")
    if camera is None and {"mass_kg", "shape"} <= data.keys():
        raise CalibrationError(
            f"{path}: is an object file, not a camera or rig file: `analyze calibrate BOARD.mp4 -o "
            "camera.toml` makes a camera file"
        )
    placed = True
    if isinstance(camera, dict):
        camera.setdefault("address", "none")
        calibration = camera.setdefault("calibration", {})
        if isinstance(calibration, dict):
            placed = "T_world_camera" in calibration
            # The command is about to measure the missing entries: any valid values serve until then.
            some: dict[str, Any] = {
                "width": 1,
                "height": 1,
                "K": np.eye(3).tolist(),
                "T_world_camera": np.eye(4).tolist(),
            }
            camera["calibration"] = some | calibration
    rig = validate(RigConfig, data, str(path))
    return rig, rig.camera.calibration.T_world_camera if placed else None
