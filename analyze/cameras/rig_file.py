"""A calibration as TOML, by itself or in the rig file."""

from __future__ import annotations

from pathlib import Path

from analyze.cameras.calibrate import CalibrationAnswer, read_rig, spec_of, toml_entries
from analyze.errors import CalibrationError
from analyze.output_file import write_text
from schemas.toml_table import with_table

TABLE = "camera.calibration"


def default_picture(output: Path) -> Path:
    """Beside the calibration."""
    return output.with_suffix(".png")


def parse_mark(text: str) -> tuple[float, float, float]:
    """Millimetres as people write them, in metres.

    Raises:
        CalibrationError: not understood.
    """
    try:
        x, y, z = (float(part) / 1000 for part in text.split(","))
    except ValueError:
        x = y = z = float("nan")
    if not all(abs(each) < 2.0 for each in (x, y, z)):
        raise CalibrationError(f"--mark-mm {text}: not understood: write x,y,z in millimetres, as 0,0,3")
    return x, y, z


def write_calibration(answer: CalibrationAnswer, output: Path) -> None:
    """Write the table as a file of its own, to be put into a rig file.

    Raises:
        OutputError: the file cannot be written.
    """
    found, board = answer.calibration, answer.options.board
    what = f"{len(found.shots)} views of ChArUco {board.columns}x{board.rows}, squares {board.square_mm:g} mm"
    lines = [
        f"# analyze calibrate: {what}; pixels known to {found.pixels.worst:.2g} px at worst",
        "# The rig file's [camera.calibration]: this in place of it.",
        f"[{TABLE}]",
        *(f"{key} = {value}" for key, value in toml_entries(answer).items()),
    ]
    if answer.world_camera is None:
        lines.append("# T_world_camera: not measured: keep the rig file's, or calibrate with --table IMAGE")
    write_text(output, "\n".join(lines) + "\n")


def refuse_unplaced(rig: Path) -> None:
    """Say before the work that this rig file says nothing of where the camera stands; for where it will not be measured.

    Raises:
        CalibrationError: so it is, or there is no such file.
    """
    if read_rig(rig)[1] is None:
        raise _unplaced(rig)


def _unplaced(rig: Path) -> CalibrationError:
    return CalibrationError(
        f"{rig}: says nothing of where the camera stands (T_world_camera), which is not measured here: add --table IMAGE"
    )


def write_into_rig(answer: CalibrationAnswer, rig: Path) -> None:
    """Put the table into the rig file; every other line stays as it is.

    Raises:
        CalibrationError: its table is not written as [camera.calibration], or nothing says where the camera stands.
        OutputError: the file cannot be written.
    """
    if spec_of(answer) is None:
        raise _unplaced(rig)
    text = with_table(rig.read_text(encoding="utf-8"), TABLE, toml_entries(answer))
    if text is None:
        raise CalibrationError(f"{rig}: has no plain table [{TABLE}] to write in: put what -o writes there by hand")
    write_text(rig, text)
