"""A camera calibration as a table on the terminal and as JSON."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rich.table import Table

from analyze.calibration.choose import MOST_VIEWS
from analyze.calibration.place import CameraPlace
from analyze.calibration.verdict import place_in_image
from analyze.cameras.calibrate import CalibrationAnswer
from analyze.cameras.calibration_toml import calibration_spec
from schemas.document import SCHEMA_VERSION
from schemas.terminal import Terminal
from schemas.wording import counted

MAX_NAMED = 4
"""largest number of images named; more are counted"""


def render_calibration(answer: CalibrationAnswer, console: Terminal | None = None) -> None:
    """Print a camera calibration as a table, with images not used, doubts and notes.

    Args:
        answer: the calibration.
        console: where to print; None for standard output.
    """
    console = console or Terminal()
    found = answer.calibration
    lens = found.lens
    table = Table(
        title=f"{lens.model.value}, {lens.width} x {lens.height} px, {counted(len(found.shots), 'view')}",
        title_justify="left",
        show_header=False,
    )
    table.add_column()
    table.add_column()
    numbers = {name: (value, sd) for name, value, sd in zip(lens.names, lens.numbers, found.sd, strict=True)}
    for label, names in (("focal length", ("fx", "fy")), ("principal point", ("cx", "cy"))):
        each = "  ".join(f"{name} {numbers[name][0]:.2f} ± {numbers[name][1]:.2f}" for name in names)
        table.add_row(label, f"{each} px")
    bend = "  ".join(f"{name} {_with_sd(*numbers[name])}" for name in lens.names[4:])
    table.add_row("distortion", bend)
    many = sum(len(shot.view.place) for shot in found.shots)
    table.add_row(
        "corners",
        f"{many}, {found.rms_px:.3f} px rms residual, over {100 * found.covered.share:.0f} % of the image",
    )
    table.add_row(
        "projection",
        f"± {found.pixels.median:.3f} px in the median, ± {found.pixels.worst:.3f} px at worst "
        f"({place_in_image(lens, *found.pixels.worst_at)})",
    )
    table.add_row(
        "board tilted by",
        f"{math.degrees(min(found.tilts)):.0f}-{math.degrees(max(found.tilts)):.0f} degrees",
    )
    if answer.place is not None:
        table.add_row("camera in W", place_line(answer.place))
    console.print(table)
    if answer.alike:
        console.print(
            f"{answer.alike} of {counted(answer.looked_at, 'image')} not used: the board lies as in another",
        )
    if answer.surplus:
        console.print(
            f"{answer.surplus} of {counted(answer.looked_at, 'image')} not used: "
            f"{counted(MOST_VIEWS, 'view')}, which differ more, are enough",
            highlight=False,
        )
    if answer.without_board:
        console.print(f"no board in {_names(answer.without_board)}")
    for left in answer.dropped[:MAX_NAMED]:
        console.print(f"left out: {left.name}: {left.reason}")
    if len(answer.dropped) > MAX_NAMED:
        console.print(f"left out: {len(answer.dropped) - MAX_NAMED} more; --json names all")
    for doubt in answer.doubts:
        console.print(f"doubt: {doubt}")
    for note in notes(answer):
        console.print(f"note: {note}")


def place_line(place: CameraPlace) -> str:
    """Words for a camera's pose: its place [m] with sd [mm], and the sd of its rotation [degrees]."""
    x, y, z = place.T_world_camera[:3, 3]
    sx, sy, sz = 1000 * place.position_sd
    turns = ", ".join(f"{sd:.3f}" for sd in np.degrees(place.turn_sd))
    return f"({x:.4f}, {y:.4f}, {z:.4f}) m ± ({sx:.2f}, {sy:.2f}, {sz:.2f}) mm; turns ± ({turns}) degrees"


def place_json(place: CameraPlace) -> dict[str, Any]:
    """Camera's pose in W, its standard deviations [rad, m], corners used and residual [px], as JSON."""
    return {
        "T_world_camera": place.T_world_camera.tolist(),
        "turn_sd_rad": place.turn_sd.tolist(),
        "position_sd_m": place.position_sd.tolist(),
        "corners": place.corners,
        "rms_px": place.rms_px,
    }


def notes(answer: CalibrationAnswer) -> list[str]:
    """Notes on what the calibration does not determine (camera pose, vertical), as lines of text.

    If the pose was measured, the first line states that its distance depends on the stated size of the
    board's squares.
    """
    lines: list[str] = []
    if answer.place is not None and answer.options.mat is not None:
        lines.append(
            "the pose's sd holds for a mat whose ruler was measured, taped flat: 0.1 % of scale, "
            "0.15 mm of curl"
        )
    elif answer.place is not None:
        lines.append(
            f"the camera's distance depends on squares of {answer.options.board.square_mm:g} mm, which no "
            "image can check: measure both rulers on the print; errors in placing the board are not in the sd"
        )
    elif answer.rig_place is not None:
        lines.append(
            "the camera's pose is the rig file's, found with the previous lens: --table IMAGE measures it "
            "with this one"
        )
    else:
        or_kept = "" if answer.rig is not None else ", or --rig RIG.toml to keep the rig's"
        lines.append(
            "the camera's pose (T_world_camera) was not measured: for videos `analyze import` finds it from "
            f"the object at rest, or from a mat; for a rig give --table IMAGE or --mat IMAGE{or_kept}"
        )
    if answer.rig is None and answer.place is None:
        return lines
    level = "" if answer.rig is None else f" ({answer.rig.gravity_tilt_sd_rad:g} rad)"
    lines.append(
        f"a board shows the table, not the vertical: the rig's gravity_tilt_sd_rad{level} is unchanged"
    )
    return lines


def calibration_json(answer: CalibrationAnswer) -> dict[str, Any]:
    """Lens, uncertainty, views and camera pose of a calibration, as JSON values.

    Units are in the keys (`_px`, `_m`, `_rad`). These values may be None: `place`, the camera's pose, if it
    was not measured; `calibration`, the table for a rig file, if the pose is not in the rig file either;
    `gravity_tilt_sd_rad` if no rig file is given; and points of `pixel_sd` beyond a fisheye's range.
    """
    found = answer.calibration
    lens, place, spec = found.lens, answer.place, calibration_spec(answer)
    units = {"fx": "px", "fy": "px", "cx": "px", "cy": "px"}
    board = answer.options.board
    views = [
        {
            "name": shot.name,
            "corners": len(shot.view.place),
            "rms_px": float(np.sqrt(np.mean(np.sum(residual**2, axis=1)))),
            "blur_px": shot.view.blur,
            "tilt_rad": tilt,
        }
        for shot, residual, tilt in zip(found.shots, found.bundle.residuals, found.tilts, strict=True)
    ]
    return {
        "schema_version": SCHEMA_VERSION,
        "model": lens.model.value,
        "width": lens.width,
        "height": lens.height,
        "board": {
            "family": board.family,
            "columns": board.columns,
            "rows": board.rows,
            "square_m": board.square_mm / 1000,
        },
        "numbers": {
            name: {"value": float(value), "sd": float(sd), "unit": units.get(name, "")}
            for name, value, sd in zip(lens.names, lens.numbers, found.sd, strict=True)
        },
        "covariance": found.covariance.tolist(),
        "determined": not found.undetermined,
        "undetermined": list(found.undetermined),
        "doubts": list(answer.doubts),
        "notes": notes(answer),
        "rms_px": found.rms_px,
        "scatter": found.scatter,
        "pixel_sd": {
            "median_px": found.pixels.median,
            "worst_px": found.pixels.worst,
            "worst_at_px": list(found.pixels.worst_at),
            "column_px": found.pixels.column.tolist(),
            "row_px": found.pixels.row.tolist(),
            "px": [
                [None if math.isnan(value) else round(value, 5) for value in row]
                for row in found.pixels.value.tolist()
            ],
        },
        "coverage": {"share": found.covered.share, "corners": found.covered.count.astype(int).tolist()},
        "views": views,
        "images": answer.looked_at,
        "without_board": list(answer.without_board),
        "alike": answer.alike,
        "surplus": answer.surplus,
        "dropped": [{"name": left.name, "reason": left.reason} for left in answer.dropped],
        "corners_dropped": found.corners_dropped,
        "place": None if place is None else place_json(place),
        "gravity_tilt_sd_rad": None if answer.rig is None else answer.rig.gravity_tilt_sd_rad,
        "calibration": None if spec is None else spec.model_dump(mode="json"),
    }


def _with_sd(value: float, sd: float) -> str:
    """Text "value ± sd", with two significant digits of the sd."""
    digits = max(0, 1 - math.floor(math.log10(max(sd, 1e-9))))
    return f"{value:.{digits}f} ± {sd:.{digits}f}"


def _names(names: tuple[str, ...]) -> str:
    """Text of the first `MAX_NAMED` names, separated by commas, and how many more there are."""
    return (
        ", ".join(names)
        if len(names) <= MAX_NAMED
        else f"{', '.join(names[:MAX_NAMED])} and {len(names) - MAX_NAMED} more"
    )
