"""Writes a camera calibration as TOML, to a file of its own or into a rig file."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from analyze.cameras.calibrate import CalibrationAnswer
from analyze.cameras.rig_file import read_rig
from analyze.errors import CalibrationError
from analyze.types import Array
from schemas.document import validate
from schemas.input_file import read_text
from schemas.output_file import write_text
from schemas.session_manifest import CameraCalibrationSpec
from schemas.toml_table import with_entry, with_table
from schemas.wording import counted

TABLE = "camera.calibration"
"""name of the rig file's table with the calibration"""


def calibration_spec(answer: CalibrationAnswer) -> CameraCalibrationSpec | None:
    """Content of a rig file's table [camera.calibration] for a new calibration.

    None if the camera's pose in the world frame was neither measured nor is in the rig file.
    """
    if answer.world_camera is None:
        return None
    table = "\n".join(f"{key} = {value}" for key, value in toml_entries(answer).items())
    return validate(CameraCalibrationSpec, tomllib.loads(table), "calibration")


def toml_entries(answer: CalibrationAnswer) -> Mapping[str, str]:
    """Entries of a rig file's table [camera.calibration] for a new calibration: TOML texts by key.

    T_world_camera (the camera's pose) is left out if unknown. The row delay line_time_s is taken over from
    the rig file, if there is one with a value other than 0.
    """
    lens = answer.calibration.lens
    entries = {
        "model": f'"{lens.model.value}"',
        "width": str(lens.width),
        "height": str(lens.height),
        "K": _matrix_toml(lens.camera_matrix, 4),
        "distortion": _row_toml(lens.distortion, 8),
    }
    T = answer.world_camera
    if T is not None:
        entries["T_world_camera"] = _matrix_toml(T, 8)
    # The line time is a property of the sensor, not of the lens.
    if answer.rig is not None and answer.rig.camera.calibration.line_time_s:
        entries["line_time_s"] = repr(answer.rig.camera.calibration.line_time_s)
    strain_sd = f"{answer.calibration.strain_sd:.1e}"
    return entries | {"rms_px": f"{answer.calibration.rms_px:.4f}", "strain_sd": strain_sd}


def _matrix_toml(rows: Any, digits: int) -> str:
    """TOML text of a matrix, row by row, with numbers rounded to `digits` decimals."""
    return f"[{', '.join(_row_toml(row, digits) for row in rows)}]"


def _row_toml(values: Any, digits: int) -> str:
    """TOML text of a list of numbers, rounded to `digits` decimals."""
    return f"[{', '.join(repr(round(float(value), digits) + 0.0) for value in values)}]"


def write_calibration(answer: CalibrationAnswer, output: Path) -> None:
    """Write the calibration as a TOML file of its own, to be copied into a rig file.

    Raises:
        OutputError: the file cannot be written.
    """
    found, board = answer.calibration, answer.options.board
    what = (
        f"{counted(len(found.shots), 'view')} of ChArUco {board.columns}x{board.rows}, squares "
        f"{board.square_mm:g} mm"
    )
    lines = [
        f"# analyze calibrate: {what}; pixels known to {found.pixels.worst:.2g} px at worst",
        "# Replace the rig file's [camera.calibration] with this table.",
        f"[{TABLE}]",
        *(f"{key} = {value}" for key, value in toml_entries(answer).items()),
    ]
    if answer.world_camera is None:
        lines.append(
            "# T_world_camera was not measured: keep the rig file's, or calibrate with --mat or --table IMAGE"
        )
    write_text(output, "\n".join(lines) + "\n")


def refuse_unplaced(rig: Path) -> None:
    """Refuse a rig file that has no camera pose (T_world_camera).

    It is called before any work if the calibration will not measure the pose.

    Raises:
        CalibrationError: the file has no T_world_camera, does not exist or cannot be read.
        DocumentError: an entry of the file has a value that is not allowed.
    """
    if read_rig(rig)[1] is None:
        raise _unplaced(rig)


def _unplaced(rig: Path) -> CalibrationError:
    """Error for a rig file that has no camera pose, when the calibration does not measure it."""
    return CalibrationError(
        f"{rig}: has no camera pose (T_world_camera), and none is measured here: add --table IMAGE, or "
        "--mat IMAGE"
    )


def write_pose_into_rig(T_world_camera: Array, rig: Path) -> None:
    """Write the camera's pose into a rig file's table [camera.calibration]; all else stays as it is.

    Args:
        T_world_camera: (4, 4) pose of the camera in the world frame [m].
        rig: rig file, which exists.

    Raises:
        CalibrationError: the file has no plain table to write into.
        OutputError: the file cannot be written.
    """
    pose = _matrix_toml(T_world_camera, 8)
    text = with_entry(read_text(rig), TABLE, "T_world_camera", pose)
    if text is None:
        raise CalibrationError(
            f"{rig}: has no plain table [{TABLE}] to write into: add by hand T_world_camera = {pose}"
        )
    write_text(rig, text)


def write_into_rig(answer: CalibrationAnswer, rig: Path) -> None:
    """Write the calibration into the table [camera.calibration] of a rig file.

    Lines outside this table stay as they are; a missing table is added, and entries of it that a calibration
    does not have are removed.

    Args:
        answer: the calibration.
        rig: rig file, which exists.

    Raises:
        CalibrationError: the table is written in another form than below a line [camera.calibration], or the
            camera's pose is unknown.
        OutputError: the file cannot be written.
    """
    if calibration_spec(answer) is None:
        raise _unplaced(rig)
    text = with_table(read_text(rig), TABLE, toml_entries(answer))
    if text is None:
        raise CalibrationError(
            f"{rig}: has no plain table [{TABLE}] to write into: copy what -o writes by hand"
        )
    write_text(rig, text)
