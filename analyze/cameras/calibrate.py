"""`analyze calibrate`: images of a board become a camera's calibration, or one line that says what is missing."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analyze.calibration.calibrate import Calibration, Dropped, Shot, calibrate
from analyze.calibration.choose import different, outline
from analyze.calibration.detect import Sight, families_seen, find_corners, likely_squares, look
from analyze.calibration.place import LYING, STANDING, CameraPlace, oddities, place_camera
from analyze.calibration.verdict import LEAST_VIEWS
from analyze.cameras.board_images import Image, images, named_files, one_image
from analyze.errors import CalibrationError
from analyze.tags.families import ON_BOARDS
from analyze.tags.sheet import Board
from schemas.document import validate
from schemas.rig import RigConfig
from schemas.session_manifest import CameraCalibrationSpec, LensModel

BLURRED = 2.0
"""times the usual blur: such a view is left out"""
BLURRED_PX = 1.6
LOOKED_AT = 5
"""images in which another family or layout is looked for"""
TABLE_MISFIT_PX = 0.5
"""rms of the table's view by the lens found: more, and it is of another camera, focus or region"""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class CalibrateOptions:
    """What the user asks for."""

    inputs: tuple[Path, ...]
    board: Board
    model: LensModel = LensModel.PINHOLE
    table: Path | None = None
    """an image of the board on the table"""
    upright: bool = False
    mark_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """where the board's mark is in W, in that image"""
    rig: Path | None = None


@dataclass(frozen=True)
class CalibrationAnswer:
    """What was found, and from what."""

    options: CalibrateOptions
    calibration: Calibration
    place: CameraPlace | None
    rig: RigConfig | None
    rig_place: list[list[float]] | None
    """T_world_camera as the rig file has it"""
    looked_at: int
    """images"""
    without_board: tuple[str, ...]
    """names of images that show no board"""
    alike: int
    """views left out because another shows the same"""
    dropped: tuple[Dropped, ...]
    doubts: tuple[str, ...]

    @property
    def world_camera(self) -> list[list[float]] | None:
        """As measured, else the rig file's, else None."""
        return self.rig_place if self.place is None else self.place.T_world_camera.tolist()

    def refuse_undetermined(self) -> None:
        """Raise CalibrationError where the views do not determine the lens."""
        if self.calibration.undetermined:
            used = len(self.calibration.shots)
            raise CalibrationError(f"{used} views do not determine the lens: {'; '.join(self.calibration.undetermined)}")


def calibrate_camera(options: CalibrateOptions, progress: Progress) -> CalibrationAnswer:
    """Read the images, find the board, solve.

    Raises:
        CalibrationError: an image cannot be read, sizes differ, no board is seen, or views are too few.
        RecordingError: a recording cannot be read.
        DocumentError: the rig file is none.
    """
    rig, rig_place = (None, None) if options.rig is None else read_rig(options.rig)
    seen: list[tuple[str, Image, Sight]] = []
    blind: list[str] = []
    looked_at = 0
    nothing: list[Image] = []
    size: tuple[str, tuple[int, ...]] | None = None
    for name, image in images(named_files(options.inputs), progress):
        looked_at += 1
        size = size or (name, image.shape)
        _refuse_size(name, image, size, rig)
        sight = look(image, options.board)
        if sight.tags:
            seen.append((name, image, sight))
        else:
            blind.append(name)
            nothing += [image] if len(nothing) < LOOKED_AT else []
    if not seen:
        raise CalibrationError(_no_board(looked_at, nothing, options.board))
    _refuse_other_board([sight for _, _, sight in seen], options.board)
    shots, alike, dropped = _shots(seen, options.board, progress)
    if len(shots) < LEAST_VIEWS:
        why = [f"{alike} show the board where another does"] if alike else []
        why += [f"{len(blind)} show no board"] if blind else []
        why += [f"{len(dropped)} are blurred or show too little of it"] if dropped else []
        images_said = "1 image" if looked_at == 1 else f"{looked_at} images"
        views = "1 view" if len(shots) == 1 else f"{len(shots)} views"
        reasons = f" ({', '.join(why)})" if why else ""
        raise CalibrationError(
            f"{views} of the board from {images_said}{reasons}: at least {LEAST_VIEWS} are needed, 15 are good: add views from other "
            "places and tilts"
        )
    found = calibrate(shots, options.board, options.model, progress)
    place = None if options.table is None or found.undetermined else _place(options, options.table, found)
    doubts = (*found.doubts, *(() if place is None else oddities(place.T_world_camera)))
    return CalibrationAnswer(options, found, place, rig, rig_place, looked_at, tuple(blind), alike, (*dropped, *found.dropped), doubts)


def read_rig(path: Path) -> tuple[RigConfig, list[list[float]] | None]:
    """The rig whose camera it is, and its T_world_camera; calibration and address may be missing still.

    Raises:
        CalibrationError: the file is missing or no TOML.
        DocumentError: it holds an entry that cannot be used.
    """
    try:
        data: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise CalibrationError(f"{path}: no such rig file: check the path") from None
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise CalibrationError(f"{path}: not valid TOML: {error}") from None
    camera = data.get("camera")
    placed = True
    if isinstance(camera, dict):
        camera.setdefault("address", "none")
        calibration = camera.setdefault("calibration", {})
        if isinstance(calibration, dict):
            placed = "T_world_camera" in calibration
            # What is missing is what this command is for.
            some: dict[str, Any] = {"width": 1, "height": 1, "K": np.eye(3).tolist(), "T_world_camera": np.eye(4).tolist()}
            camera["calibration"] = some | calibration
    rig = validate(RigConfig, data, str(path))
    return rig, rig.camera.calibration.T_world_camera if placed else None


def spec_of(answer: CalibrationAnswer) -> CameraCalibrationSpec | None:
    """As the rig file takes it; None where nothing says where the camera stands."""
    if answer.world_camera is None:
        return None
    table = "\n".join(f"{key} = {value}" for key, value in toml_entries(answer).items())
    return validate(CameraCalibrationSpec, tomllib.loads(table), "calibration")


def toml_entries(answer: CalibrationAnswer) -> Mapping[str, str]:
    """The table [camera.calibration], key -> value as TOML."""
    lens = answer.calibration.lens
    entries = {
        "model": f'"{lens.model.value}"',
        "width": str(lens.width),
        "height": str(lens.height),
        "K": _matrix(lens.camera_matrix, 4),
        "distortion": _row(lens.distortion, 8),
    }
    T = answer.world_camera
    if T is not None:
        entries["T_world_camera"] = _matrix(T, 8)
    if answer.rig is not None and answer.rig.camera.calibration.line_time_s:  # of the sensor, not of the lens
        entries["line_time_s"] = repr(answer.rig.camera.calibration.line_time_s)
    return entries | {"rms_px": f"{answer.calibration.rms_px:.4f}"}


def _matrix(rows: Any, digits: int) -> str:
    return f"[{', '.join(_row(row, digits) for row in rows)}]"


def _row(values: Any, digits: int) -> str:
    return f"[{', '.join(repr(round(float(value), digits) + 0.0) for value in values)}]"


# --- refusals -----------------------------------------------------------------------------------------------------


def _refuse_size(name: str, image: Image, first: tuple[str, tuple[int, ...]], rig: RigConfig | None) -> None:
    height, width = image.shape
    if image.shape != first[1]:
        raise CalibrationError(
            f"{name} has {width} x {height} px, {first[0]} {first[1][1]} x {first[1][0]}: all must come from one camera with one region: "
            "leave out those of the other size"
        )
    if rig is not None and (width, height) != (rig.camera.width, rig.camera.height):
        raise CalibrationError(
            f"{name} has {width} x {height} px, the rig's camera {rig.camera.width} x {rig.camera.height}: take the images with the rig's "
            "region, uncropped and unscaled, or correct [camera] width and height"
        )


def _no_board(looked_at: int, some: Sequence[Image], board: Board) -> str:
    what = "the image shows" if looked_at == 1 else f"none of {looked_at} images shows"
    none = "no board" if looked_at == 1 else "a board"
    others: dict[str, int] = {}
    for image in some:
        for family, many in families_seen(image).items():
            others[family] = max(many, others.get(family, 0))
    # A small dictionary is the beginning of a larger one: of those alike the one that boards are printed with.
    likely = max(others, key=lambda family: (others[family], family == ON_BOARDS), default=None)
    if likely is not None and others[likely] >= 3:
        return f"{what} {none} with tags of {board.family}; tags of {likely} are seen: is it --family {likely}?"
    return (
        f"{what} {none} with tags of {board.family}: the board must be in focus, evenly lit and a third of the image or more; "
        "see --family and --squares"
    )


def _refuse_other_board(sights: Sequence[Sight], board: Board) -> None:
    beyond = sorted({tag for sight in sights for tag in sight.beyond})
    another = sum(sight.another_layout for sight in sights)
    arranged = sum(sight.pairs >= 3 for sight in sights)
    if (not another or 2 * another < arranged) and not (beyond and sum(bool(sight.beyond) for sight in sights) > len(sights) / 2):
        return
    likely = likely_squares([sight.read for sight in sights[:LOOKED_AT]], board)
    said = f"tags stand otherwise than on a board of {board.columns}x{board.rows} squares"
    if beyond:
        said = (
            f"a tag {beyond[-1]} is seen, a board of {board.columns}x{board.rows} squares ends with {board.columns * board.rows // 2 - 1}"
        )
    remedy = "give its --squares and --family as it was printed" if likely is None else f"is it --squares {likely[0]}x{likely[1]}?"
    raise CalibrationError(f"another board: {said}: {remedy}")


# --- views --------------------------------------------------------------------------------------------------------


def _shots(seen: Sequence[tuple[str, Image, Sight]], board: Board, progress: Progress) -> tuple[list[Shot], int, list[Dropped]]:
    """One view of each place of the board, with its corners; how many showed the same; what cannot be used."""
    outlined = [(name, image, sight, outline(sight, board)) for name, image, sight in seen]
    dropped = [Dropped(name, "too few tags are seen") for name, _, _, where in outlined if where is None]
    usable = [(name, image, sight, where) for name, image, sight, where in outlined if where is not None]
    width = seen[0][1].shape[1]
    chosen = different([where for *_, where in usable], [len(sight.tags) for _, _, sight, _ in usable], width)
    shots: list[Shot] = []
    for number, i in enumerate(chosen):
        name, image, sight, _ = usable[i]
        progress("finding corners", number, len(chosen))
        view = find_corners(image, board, sight)
        if view is None:
            dropped.append(Dropped(name, "too few corners are sharp"))
        else:
            shots.append(Shot(name, image, view))
    usual = float(np.median([shot.view.blur for shot in shots])) if shots else 0.0
    limit = max(BLURRED * usual, BLURRED_PX)
    dropped += [
        Dropped(shot.name, f"blurred, {shot.view.blur:.1f} px where others have {usual:.1f} px: it moved or is out of focus")
        for shot in shots
        if shot.view.blur > limit
    ]
    return [shot for shot in shots if shot.view.blur <= limit], len(usable) - len(chosen), dropped


def _place(options: CalibrateOptions, table: Path, found: Calibration) -> CameraPlace:
    image = one_image(table)
    height, width = image.shape
    if (width, height) != (found.lens.width, found.lens.height):
        raise CalibrationError(
            f"{table} has {width} x {height} px, the other images {found.lens.width} x {found.lens.height}: take it with the same camera"
        )
    sight = look(image, options.board)
    view = None if sight.another_layout else find_corners(image, options.board, sight)
    if view is None:
        raise CalibrationError(
            f"{table}: shows too little of the board ({len(sight.tags)} tags): lay it where the camera looks down on it, or stand it up, "
            "facing the camera (--upright); films may do without --table: `analyze import` finds the camera's place from the object at rest"
        )
    where = STANDING if options.upright else LYING
    place = place_camera(
        image, view, options.board, found.lens, found.covariance, found.scatter, where, np.array(options.mark_m, dtype=float)
    )
    if place.rms_px > max(TABLE_MISFIT_PX, 4.0 * found.rms_px):
        raise CalibrationError(
            f"{table}: its corners lie {place.rms_px:.2f} px from where this lens draws them, the other images' {found.rms_px:.2f} px: "
            "take it with the same camera, focus and region, and the board flat"
        )
    return place
