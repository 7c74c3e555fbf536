"""The table's tilt from images of plumb lines (strings with a weight), and its entry in the rig file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analyze.calibration.plumb import (
    MAX_SD_SHARE,
    MIN_SEPARATION_PX,
    PlumbLine,
    TableLean,
    find_plumb_lines,
    merged_line,
    table_lean,
    upright,
)
from analyze.cameras.board_images import RECORDING, Image, read_images, resolve_inputs
from analyze.cameras.rig_file import PLUMB_LINE, read_rig
from analyze.errors import CalibrationError
from analyze.pipeline.read_evidence import read_head
from analyze.progress import Progress, no_progress
from analyze.tracking.camera_model import camera_from_spec
from analyze.types import Array, CameraModel
from schemas.input_file import read_text
from schemas.output_file import write_text
from schemas.toml_table import with_table
from schemas.wording import counted

TABLE = "level"
"""table of the rig file"""
MAX_IMAGES = 60
"""largest number of images that are searched"""


@dataclass(frozen=True)
class GravityOptions:
    """Options of `analyze gravity`: images of plumb lines, rig file, accuracy of the camera's rotation."""

    inputs: tuple[Path, ...]
    """images, folders of images, patterns, videos and recordings that show the strings"""
    rig: Path | None = None
    """rig file with camera and gravity_tilt_sd_rad; None for those of the first recording in `inputs`"""
    camera_turn_sd: float = float(np.radians(0.1))
    """standard deviation of T_world_camera's rotation about each axis of W [rad]"""


@dataclass(frozen=True)
class GravityAnswer:
    """The table's tilt, and the plumb lines (hanging strings in the images) that it was measured from."""

    table: TableLean
    """lean of the vertical from the table's normal, with its covariance"""
    lines: tuple[PlumbLine, ...]
    """one line per string, from left to right in the image"""
    seen_in: tuple[int, ...]
    """number of images that show each string, in the order of `lines`"""
    looked_at: int
    """number of images searched"""
    first: Image
    """(height, width) grey values of the first image"""
    camera: CameraModel
    """camera that took the images, with its pose in the world frame W"""
    options: GravityOptions
    """options with which the tilt was measured"""

    @property
    def places_px(self) -> list[float]:
        """List of the image columns [undistorted px] of the plumb lines (strings), in the order of `lines`.

        A column is that of the middle of the visible part of the string.
        """
        return [float((line.bottom + line.top)[0] / 2) for line in self.lines]

    def refuse_undetermined(self) -> None:
        """Check that the plumb lines determine the table's tilt towards +x of W, the world frame.

        The plumb lines are the hanging strings in the images. This component of the tilt affects tips.

        Raises:
            CalibrationError: the plumb lines do not determine it, or the standard deviation assumed before
                them (`gravity_tilt_sd_rad`) is 0, so that they can change nothing.
        """
        if self.table.prior_sd == 0:
            raise CalibrationError(
                "gravity_tilt_sd_rad is 0: the table is stated to be exactly level, which no string can "
                "change: state its uncertainty"
            )
        if not self.table.determined[0]:
            x, before = np.degrees([self.table.sd[0], self.table.prior_sd])
            camera = np.degrees(self.options.camera_turn_sd)
            raise CalibrationError(
                f"the strings do not determine the table's tilt towards +x: ±{x:.2f}°, from ±{before:.2f}° "
                f"before; {MAX_SD_SHARE * before:.2f}° is needed: use a camera that looks along y, with a "
                f"pose known better than ±{camera:.2f}° against the table (calibrate --table; then "
                "--camera-sd-deg)"
            )


def read_gravity(options: GravityOptions, progress: Progress = no_progress) -> GravityAnswer:
    """Find the plumb lines in the images, and compute the table's tilt from them.

    At most `MAX_IMAGES` images are searched. The result may leave the tilt undetermined: call its
    `refuse_undetermined`.

    Args:
        options: images, rig file, and accuracy of the camera's rotation.
        progress: called with (text, files or images read, number of all).

    Returns:
        Tilt: lean [rad] of the vertical from the table's normal towards x and y of the world frame, with its
        covariance; and the plumb lines found.

    Raises:
        CalibrationError: an image cannot be read or is not of the calibration's size, no camera or no camera
            pose is given, or no plumb line is seen.
        ImportRefused: a video cannot be read.
        RecordingError: a recording cannot be read.
        DocumentError: an entry of the rig file has a value that is not allowed.
    """
    files = resolve_inputs(options.inputs)
    camera, prior_sd = _camera(files, options)
    seen: list[PlumbLine] = []
    of_image: list[int] = []
    slanted, looked_at = 0, 0
    first: Image | None = None
    for name, image in read_images(files, progress):
        height, width = image.shape
        if (width, height) != (camera.width, camera.height):
            raise CalibrationError(
                f"{name} has {width} x {height} px, the camera's calibration {camera.width} x "
                f"{camera.height}: take it with the rig's region, uncropped and unscaled"
            )
        if looked_at == MAX_IMAGES:
            break
        first = image if first is None else first
        lines = find_plumb_lines(image, camera)
        plumb = upright(lines, camera)
        slanted += len(lines) - len(plumb)
        seen += plumb
        of_image += [looked_at] * len(plumb)
        looked_at += 1
    if first is None or not seen:
        off = f" ({slanted} straight lines are more than 5° off W's vertical)" if slanted else ""
        raise CalibrationError(
            f"no plumb line is seen in {counted(looked_at, 'image')}{off}: hang a thin "
            "string with a weight before a uniform background, dark on bright or bright on dark, over half "
            "the image's height or more, and wait until it is still"
        )
    groups = _same_string(seen)
    lines = tuple(merged_line([seen[i] for i in group]) for group in groups)
    seen_in = tuple(len({of_image[i] for i in group}) for group in groups)
    return GravityAnswer(
        table_lean(lines, camera, prior_sd, options.camera_turn_sd),
        lines,
        seen_in,
        looked_at,
        first,
        camera,
        options,
    )


def _camera(files: Sequence[Path], options: GravityOptions) -> tuple[CameraModel, float]:
    """Camera with its pose, and the standard deviation of the table's tilt before the measurement [rad].

    Both come from the rig file if the options name one, otherwise from the first recording among `files`.

    Raises:
        CalibrationError: the rig file has no camera pose, or there is neither rig file nor recording.
    """
    if options.rig is not None:
        rig, place = read_rig(options.rig)
        if place is None:
            raise CalibrationError(
                f"{options.rig}: has no camera pose (T_world_camera): measure it with analyze calibrate "
                "--table IMAGE"
            )
        return camera_from_spec(rig.camera.calibration), rig.gravity_tilt_sd_rad
    recording = next((path for path in files if path.suffix == RECORDING), None)
    if recording is None:
        raise CalibrationError(
            "the images' camera is unknown: give --rig RIG.toml with its [camera.calibration]"
        )
    manifest = read_head(recording).manifest
    return camera_from_spec(manifest.cameras[0].calibration), manifest.gravity_tilt_sd_rad


def _same_string(lines: Sequence[PlumbLine]) -> list[list[int]]:
    """Group the plumb lines that show the same string, in one image or in several.

    A line belongs to the string of its left neighbour if the middles of the two are less than
    `MIN_SEPARATION_PX` apart in the image.

    Returns:
        A list of indices into `lines` per string; the strings from left to right.
    """
    middles: Array = np.array([(line.bottom + line.top)[0] / 2 for line in lines])
    groups: list[list[int]] = []
    for i in np.argsort(middles, kind="stable").tolist():
        if groups and middles[i] - middles[groups[-1][-1]] < MIN_SEPARATION_PX:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def level_entries(answer: GravityAnswer) -> dict[str, str]:
    """Entries for the rig file's table [level]: TOML text of each value, by key.

    They are the tilt [rad], its standard deviation [rad], and `read_by`, the method of measurement (plumb
    line). The tilt towards y of the world frame W is included only if the plumb lines determine it. The tilt
    towards x is always included: call `refuse_undetermined` first.
    """
    (x, y), (x_sd, y_sd) = answer.table.lean.tolist(), answer.table.sd.tolist()
    entries = {"towards_x_rad": f"{x:.6f}", "towards_x_sd_rad": f"{x_sd:.6f}"}
    if answer.table.determined[1]:
        entries |= {"towards_y_rad": f"{y:.6f}", "towards_y_sd_rad": f"{y_sd:.6f}"}
    return entries | {"read_by": f'"{PLUMB_LINE}"'}


def write_level(answer: GravityAnswer, rig: Path) -> None:
    """Write the measured tilt into the rig file as its table [level]; all other tables stay unchanged.

    Raises:
        CalibrationError: the tilt is not determined, or the file's [level] is not written as a plain table.
        OutputError: the file cannot be written.
    """
    answer.refuse_undetermined()
    text = with_table(read_text(rig), TABLE, level_entries(answer))
    if text is None:
        lines = "; ".join(f"{key} = {value}" for key, value in level_entries(answer).items())
        raise CalibrationError(f"{rig}: has no plain table [{TABLE}] to write into: add by hand {lines}")
    write_text(rig, text)
