"""`analyze gravity`: images of a string with a weight become the rig file's level reading, or one line that says what is missing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analyze.calibration.plumb import APART_PX, DETERMINED, PlumbedTable, PlumbLine, find_plumb_lines, plumbed_table, together, upright
from analyze.cameras.board_images import RECORDING, Image, images, named_files
from analyze.cameras.calibrate import read_rig
from analyze.errors import CalibrationError
from analyze.output_file import write_text
from analyze.pipeline.evidence import read_head
from analyze.tracking.camera_model import camera_from_spec
from analyze.types import Array, CameraModel
from schemas.document import SCHEMA_VERSION
from schemas.toml_table import with_table

TABLE = "level"
READ_BY = "plumb line"
MOST_IMAGES = 60

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class GravityOptions:
    """What the user asks for."""

    inputs: tuple[Path, ...]
    rig: Path | None = None
    """None: the recording's camera and level"""
    camera_turn_sd: float = float(np.radians(0.1))
    """rad, 1 sigma of T_world_camera's turn about each axis of W"""


@dataclass(frozen=True)
class GravityAnswer:
    """What the strings show."""

    table: PlumbedTable
    lines: tuple[PlumbLine, ...]
    """one per string"""
    seen_in: tuple[int, ...]
    """images, of each"""
    looked_at: int
    first: Image
    camera: CameraModel
    options: GravityOptions

    @property
    def places_px(self) -> list[float]:
        """Column of each string in the middle of its stretch, ideal px."""
        return [float((line.bottom + line.top)[0] / 2) for line in self.lines]

    def refuse_undetermined(self) -> None:
        """Raise CalibrationError where the strings do not tell the rise towards +x, which tips feel."""
        if self.table.prior_sd == 0:
            raise CalibrationError(
                "gravity_tilt_sd_rad is 0: the table is stated to be level, and strings cannot tell otherwise: state what it is unsure of"
            )
        if not self.table.determined[0]:
            x, before = np.degrees([self.table.sd[0], self.table.prior_sd])
            camera = np.degrees(self.options.camera_turn_sd)
            raise CalibrationError(
                f"the strings do not tell how the table rises towards +x: ±{x:.2f}°, known to ±{before:.2f}° before, "
                f"{DETERMINED * before:.2f}° is wanted: a camera that looks along y shows it; it must itself be known better than "
                f"±{camera:.2f}° against the table (calibrate --table; then --camera-sd-deg)"
            )


def read_gravity(options: GravityOptions, progress: Progress = lambda _text, _done, _total: None) -> GravityAnswer:
    """Find the strings, and the vertical by them.

    Raises:
        CalibrationError: an image cannot be read or is of another size, no camera is given, or no string is seen.
        RecordingError: a recording cannot be read.
        DocumentError: the rig file cannot be used.
    """
    files = named_files(options.inputs)
    camera, prior_sd = _camera(files, options)
    seen: list[PlumbLine] = []
    of_image: list[int] = []
    slanted, looked_at = 0, 0
    first: Image | None = None
    for name, image in images(files, progress):
        height, width = image.shape
        if (width, height) != (camera.width, camera.height):
            raise CalibrationError(
                f"{name} has {width} x {height} px, the camera's calibration {camera.width} x {camera.height}: take it with the rig's "
                "region, uncropped and unscaled"
            )
        if looked_at == MOST_IMAGES:
            break
        first = image if first is None else first
        lines = find_plumb_lines(image, camera)
        plumb = upright(lines, camera)
        slanted += len(lines) - len(plumb)
        seen += plumb
        of_image += [looked_at] * len(plumb)
        looked_at += 1
    if first is None or not seen:
        off = f" ({slanted} straight lines are seen, more than 5° off W's vertical)" if slanted else ""
        raise CalibrationError(
            f"no plumb line is seen in {looked_at} image{'' if looked_at == 1 else 's'}{off}: hang a thin string with a weight before an "
            "even ground, dark on bright or bright on dark, over half the image's height or more, and wait until it is still"
        )
    groups = _same_string(seen)
    lines = tuple(together([seen[i] for i in group]) for group in groups)
    seen_in = tuple(len({of_image[i] for i in group}) for group in groups)
    return GravityAnswer(plumbed_table(lines, camera, prior_sd, options.camera_turn_sd), lines, seen_in, looked_at, first, camera, options)


def _camera(files: Sequence[Path], options: GravityOptions) -> tuple[CameraModel, float]:
    if options.rig is not None:
        rig, place = read_rig(options.rig)
        if place is None:
            raise CalibrationError(
                f"{options.rig}: says nothing of where the camera stands (T_world_camera): analyze calibrate --table IMAGE measures it"
            )
        return camera_from_spec(rig.camera.calibration), rig.gravity_tilt_sd_rad
    recording = next((path for path in files if path.suffix == RECORDING), None)
    if recording is None:
        raise CalibrationError("images do not say which camera took them: give --rig RIG.toml with its [camera.calibration]")
    manifest = read_head(recording).manifest
    return camera_from_spec(manifest.cameras[0].calibration), manifest.gravity_tilt_sd_rad


def _same_string(lines: Sequence[PlumbLine]) -> list[list[int]]:
    """Indices of lines at one place of the image, from left to right."""
    middles: Array = np.array([(line.bottom + line.top)[0] / 2 for line in lines])
    groups: list[list[int]] = []
    for i in np.argsort(middles, kind="stable").tolist():
        if groups and middles[i] - middles[groups[-1][-1]] < APART_PX:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def level_entries(answer: GravityAnswer) -> dict[str, str]:
    """The rig file's [level], key -> value as TOML; what is not determined is left out."""
    (x, y), (x_sd, y_sd) = answer.table.lean.tolist(), answer.table.sd.tolist()
    entries = {"towards_x_rad": f"{x:.6f}", "towards_x_sd_rad": f"{x_sd:.6f}"}
    if answer.table.determined[1]:
        entries |= {"towards_y_rad": f"{y:.6f}", "towards_y_sd_rad": f"{y_sd:.6f}"}
    return entries | {"read_by": f'"{READ_BY}"'}


def write_level(answer: GravityAnswer, rig: Path) -> None:
    """Put the reading into the rig file; every other line stays as it is.

    Raises:
        CalibrationError: the strings do not tell enough, or the file has no plain table [level].
        OutputError: the file cannot be written.
    """
    answer.refuse_undetermined()
    text = with_table(rig.read_text(encoding="utf-8"), TABLE, level_entries(answer))
    if text is None:
        lines = "; ".join(f"{key} = {value}" for key, value in level_entries(answer).items())
        raise CalibrationError(f"{rig}: has no plain table [{TABLE}] to write in: put there by hand {lines}")
    write_text(rig, text)


def gravity_text(answer: GravityAnswer) -> list[str]:
    """For people, a line each."""
    table = answer.table
    said: list[str] = []
    for line, place, many in zip(answer.lines, answer.places_px, answer.seen_in, strict=True):
        length = float(np.linalg.norm(line.top - line.bottom))
        kind = "dark" if line.dark else "bright"
        said.append(f"{kind} string at column {place:.0f}, {length:.0f} px long, in {many} of {answer.looked_at} images")
    for i, towards in enumerate(("+x, where objects tip", "+y, away from the camera")):
        value, sd = np.degrees([table.lean[i], 1.96 * table.sd[i]])
        told = f"{value:+.3f} ± {sd:.3f}° (95 % interval)" if table.determined[i] else f"not determined (± {sd:.2f}°)"
        said.append(f"the table rises towards {towards}: {told}")
    if not table.determined[1]:
        said.append("note: strings far apart in the image would tell the second; tips as usual, and turned by 180°, do not feel it")
    sd = float(np.degrees(answer.options.camera_turn_sd))
    said.append(
        f"note: the camera's own turn against the table is taken for known to {sd:.2g}° (1 sigma; --camera-sd-deg): it is in the intervals"
    )
    if table.unlikely:
        shown, known = float(np.degrees(np.max(np.abs(table.shown)))), float(np.degrees(table.prior_sd))
        said.append(
            f"doubt: the strings lean by {shown:.2f}°, the table is stated level to ±{known:.2f}° (gravity_tilt_sd_rad): the answer lies "
            "between: level the table, state it less sure, or measure T_world_camera anew"
        )
    if table.scatter > 2:
        said.append(f"doubt: the strings disagree by {table.scatter:.1f} times their noise: one was swinging or is none; look at --picture")
    return said


def gravity_json(answer: GravityAnswer) -> dict[str, Any]:
    """Everything, ready for JSON."""
    table = answer.table
    return {
        "schema_version": SCHEMA_VERSION,
        "lean_rad": table.lean.tolist(),
        "sd_rad": table.sd.tolist(),
        "covariance_rad2": table.covariance.tolist(),
        "determined": list(table.determined),
        "prior_sd_rad": table.prior_sd,
        "camera_turn_sd_rad": answer.options.camera_turn_sd,
        "scatter": table.scatter,
        "images": answer.looked_at,
        "strings": [
            {
                "bottom_px": line.bottom.tolist(),
                "top_px": line.top.tolist(),
                "end_sd_px": line.end_sd,
                "dark": line.dark,
                "images": many,
                "residual_rad": residual,
            }
            for line, many, residual in zip(answer.lines, answer.seen_in, table.residual.tolist(), strict=True)
        ],
        "level": level_entries(answer) if table.determined[0] else None,
    }
