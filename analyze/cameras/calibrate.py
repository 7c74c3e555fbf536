"""Calibrates a camera from images of a ChArUco board."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analyze.calibration.calibrate import Calibration, Dropped, Shot, calibrate
from analyze.calibration.choose import MOST_VIEWS, distinct_views, most_different, outline
from analyze.calibration.detect import BoardSighting, families_seen, find_corners, likely_squares, read_board
from analyze.calibration.place import LYING, STANDING, CameraPlace, implausibilities, place_camera
from analyze.calibration.verdict import MIN_VIEWS
from analyze.cameras.board_images import Image, read_image, read_images, resolve_inputs
from analyze.cameras.mat_place import place_by_mat
from analyze.cameras.rig_file import read_rig
from analyze.errors import CalibrationError
from analyze.progress import Progress
from analyze.tags.families import ON_BOARDS
from analyze.tags.sheet import Board
from schemas.rig import RigConfig
from schemas.session_manifest import LensModel
from schemas.wording import counted

MAX_BLUR_RATIO = 2.0
"""blur of a view, relative to the median of all views, above which it is left out"""
MAX_BLUR_PX = 1.6
"""blur (sd of the edges) up to which a view is used in any case [px]"""
IMAGES_SEARCHED = 5
"""number of images in which another tag family or board layout is searched for"""
MAX_TABLE_MISFIT_PX = 0.5
"""rms residual [px] of the table's image above which it comes from another camera, focus or region, if the
residual also exceeds four times that of the other images"""


@dataclass(frozen=True)
class CalibrateOptions:
    """Options of a camera calibration: images, board, lens model, and how the camera's pose is measured."""

    inputs: tuple[Path, ...]
    """images, folders of images, patterns, recordings and videos"""
    board: Board
    """the printed board"""
    model: LensModel = LensModel.PINHOLE
    """lens model to fit"""
    table: Path | None = None
    """image of the board on the table; None if the camera's pose is not measured by it"""
    mat: Path | None = None
    """image of the mat on the table; None if the camera's pose is not measured by it"""
    mat_ruler_mm: float | None = None
    """length of the mat's ruler as measured on the print [mm]; None for the nominal one"""
    upright: bool = False
    """True if the board stands in the image `table`, False if it lies on the table"""
    mark_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """position of the board's mark (its origin) in the world frame W in the image `table` [m]"""
    rig: Path | None = None
    """rig file, with the expected image size and a camera pose; None if there is none"""


@dataclass(frozen=True)
class CalibrationAnswer:
    """Result of a camera calibration, with the images that it uses and leaves out."""

    options: CalibrateOptions
    """options with which the calibration was made"""
    calibration: Calibration
    """the lens with its uncertainty and the views that were used"""
    place: CameraPlace | None
    """pose of the camera in the world frame W; None if it was not measured"""
    rig: RigConfig | None
    """content of the rig file; None if none was given"""
    rig_place: list[list[float]] | None
    """T_world_camera (4, 4), the camera's pose in W, of the rig file; None if there is none"""
    looked_at: int
    """number of images that were read"""
    without_board: tuple[str, ...]
    """names of images that show no board"""
    alike: int
    """number of views left out because another shows the board in the same place"""
    surplus: int
    """number of views left out because `MOST_VIEWS` others, which differ more, are enough"""
    dropped: tuple[Dropped, ...]
    """other views that were left out, with the reasons"""
    doubts: tuple[str, ...]
    """reasons to doubt the calibration, each with a remedy"""

    @property
    def world_camera(self) -> list[list[float]] | None:
        """Camera's pose (4, 4) in the world frame, translation in m; None if unknown.

        It is the measured one, otherwise the rig file's.
        """
        return self.rig_place if self.place is None else self.place.T_world_camera.tolist()

    def refuse_undetermined(self) -> None:
        """Check that the images determine the lens.

        Raises:
            CalibrationError: the lens is not determined; the message gives the reasons.
        """
        if self.calibration.undetermined:
            used = len(self.calibration.shots)
            raise CalibrationError(
                f"{counted(used, 'view', 'does')} not determine the lens: "
                f"{'; '.join(self.calibration.undetermined)}"
            )


def calibrate_camera(options: CalibrateOptions, progress: Progress) -> CalibrationAnswer:
    """Calibrate a camera from the images of a board that the options name.

    Args:
        options: images, board and lens model.
        progress: called with a text, the number of finished steps and of all steps.

    Returns:
        Lens with its uncertainty, and the camera's pose if it is asked for. The images may fail to determine
        the lens: call `refuse_undetermined` of the result. In that case the pose is not measured.

    Raises:
        CalibrationError: an image cannot be read, sizes differ, no board or another board is seen, there are
            too few views, or the image for the pose does not fit.
        ImportRefused: a video cannot be read.
        RecordingError: a recording cannot be read.
        DocumentError: the rig file cannot be used.
    """
    rig, rig_place = (None, None) if options.rig is None else read_rig(options.rig)
    seen: list[tuple[str, Image, BoardSighting]] = []
    blind: list[str] = []
    looked_at = 0
    nothing: list[Image] = []
    size: tuple[str, tuple[int, ...]] | None = None
    for name, image in read_images(resolve_inputs(options.inputs), progress):
        looked_at += 1
        size = size or (name, image.shape)
        _refuse_size(name, image, size, rig)
        sight = read_board(image, options.board)
        if sight.tags:
            seen.append((name, image, sight))
        else:
            blind.append(name)
            nothing += [image] if len(nothing) < IMAGES_SEARCHED else []
    if not seen:
        raise CalibrationError(_no_board(looked_at, nothing, options.board))
    _refuse_other_board([sight for _, _, sight in seen], options.board)
    shots, alike, surplus, dropped = _shots(seen, options.board, progress)
    if len(shots) < MIN_VIEWS:
        left_out = {
            "show the board where another does": alike,
            f"differ less from one another than the {MOST_VIEWS} chosen": surplus,
            "show no board": len(blind),
            "are blurred or show too little of it": len(dropped),
        }
        raise CalibrationError(_too_few_views(len(shots), looked_at, left_out))
    found = calibrate(shots, options.board, options.model, progress)
    place = None
    if options.mat is not None and not found.undetermined:
        place = place_by_mat(options.mat, found.lens, found.covariance, options.mat_ruler_mm)
    elif options.table is not None and not found.undetermined:
        place = _place(options, options.table, found)
    doubts = (*found.doubts, *(() if place is None else implausibilities(place.T_world_camera)))
    return CalibrationAnswer(
        options,
        found,
        place,
        rig,
        rig_place,
        looked_at,
        tuple(blind),
        alike,
        surplus,
        (*dropped, *found.dropped),
        doubts,
    )


# --- refusals


def _refuse_size(name: str, image: Image, first: tuple[str, tuple[int, ...]], rig: RigConfig | None) -> None:
    """Check that an image has the size of the first image and of the rig's camera.

    Args:
        name: name of the image.
        image: (height, width) grey values.
        first: name and (height, width) of the first image [px].
        rig: rig with the expected size; None for no check against it.

    Raises:
        CalibrationError: the image has another size.
    """
    height, width = image.shape
    if image.shape != first[1]:
        raise CalibrationError(
            f"{name} has {width} x {height} px, {first[0]} {first[1][1]} x {first[1][0]}: all must come from "
            "one camera with one region: leave out those of the other size"
        )
    if rig is not None and (width, height) != (rig.camera.width, rig.camera.height):
        raise CalibrationError(
            f"{name} has {width} x {height} px, the rig's camera {rig.camera.width} x {rig.camera.height}: "
            "take the images with the rig's region, uncropped and unscaled, or correct [camera] width and "
            "height"
        )


def _no_board(looked_at: int, some: Sequence[Image], board: Board) -> str:
    """Text of the error that no image shows the board; it names another tag family if one is seen.

    Args:
        looked_at: number of images that were read.
        some: grey values of some of them, in which other families are searched for.
        board: the board that was expected.
    """
    what = "the image shows" if looked_at == 1 else f"none of {counted(looked_at, 'image')} shows"
    none = "no board" if looked_at == 1 else "a board"
    others: Counter[str] = Counter()
    for image in some:
        others |= Counter(families_seen(image))  # the largest count of each family
    # A large tag family contains the smaller ones of its kind: if several are equally likely, choose the one
    # that boards are printed with.
    likely = max(others, key=lambda family: (others[family], family == ON_BOARDS), default=None)
    if likely is not None and others[likely] >= 3:
        seen = f"but {counted(others[likely], 'tag')} of {likely}: try --family {likely}"
        return f"{what} {none} with tags of {board.family}, {seen}"
    return (
        f"{what} {none} with tags of {board.family}: the board must be in focus, evenly lit and a third of "
        "the image or more; see --family and --squares"
    )


def _refuse_other_board(sights: Sequence[BoardSighting], board: Board) -> None:
    """Check, by ids and arrangement of the tags, that the images may show the expected board.

    Args:
        sights: tags found in each image.
        board: the expected board.

    Raises:
        CalibrationError: more than half of the images show tags that the board does not have, or at least
            half of those with three or more pairs of neighbouring tags show another arrangement.
    """
    beyond = sorted({tag for sight in sights for tag in sight.foreign_ids})
    another = sum(sight.another_layout for sight in sights)
    arranged = sum(sight.pairs >= 3 for sight in sights)
    if (not another or 2 * another < arranged) and not (
        beyond and sum(bool(sight.foreign_ids) for sight in sights) > len(sights) / 2
    ):
        return
    likely = likely_squares([sight.read for sight in sights[:IMAGES_SEARCHED]], board)
    said = f"its tags are not arranged as on a board of {board.columns}x{board.rows} squares"
    if beyond:
        said = (
            f"it shows tag {beyond[-1]}, but the last tag of a board of {board.columns}x{board.rows} squares "
            f"is {board.columns * board.rows // 2 - 1}"
        )
    remedy = (
        "give the --squares and --family of the printed board"
        if likely is None
        else f"try --squares {likely[0]}x{likely[1]}"
    )
    raise CalibrationError(f"another board: {said}: {remedy}")


def _too_few_views(views: int, images: int, left_out: Mapping[str, int]) -> str:
    """Text of the error that too few views (usable images) are left, with their number and reasons.

    Args:
        views: number of usable images.
        images: number of images that were read.
        left_out: number of images left out, by reason, in words that continue such a number.
    """
    reasons = [f"{count} {reason}" for reason, count in left_out.items() if count]
    found = f"{counted(views, 'view')} of the board from {counted(images, 'image')}"
    why = f" ({', '.join(reasons)})" if reasons else ""
    return (
        f"{found}{why}: at least {MIN_VIEWS} are needed, 15 are good: add views from other places and tilts"
    )


# --- views


def _shots(
    seen: Sequence[tuple[str, Image, BoardSighting]], board: Board, progress: Progress
) -> tuple[list[Shot], int, int, list[Dropped]]:
    """Choose one image per place of the board, at most `MOST_VIEWS`, and find the board's corners in it.

    Args:
        seen: name, grey values and tags of each image that shows the board.
        board: the board.
        progress: called with a text, the number of finished views and of all chosen views.

    Returns:
        The images with corners; the number of images left out because another shows the board in the same
        place; the number left out because `MOST_VIEWS` others, which differ more, are enough; the unusable
        images (too few tags or corners, or blurred) with their reasons.
    """
    outlined = [(name, image, sight, outline(sight, board)) for name, image, sight in seen]
    dropped = [Dropped(name, "too few tags are seen") for name, _, _, where in outlined if where is None]
    usable = [(name, image, sight, where) for name, image, sight, where in outlined if where is not None]
    width = seen[0][1].shape[1]
    outlines = [where for *_, where in usable]
    distinct = distinct_views(outlines, [len(sight.tags) for _, _, sight, _ in usable], width)
    chosen = most_different(distinct, outlines)
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
    limit = max(MAX_BLUR_RATIO * usual, MAX_BLUR_PX)
    dropped += [
        Dropped(
            shot.name,
            f"blurred, {shot.view.blur:.1f} px where others have {usual:.1f} px: it moved or is out of focus",
        )
        for shot in shots
        if shot.view.blur > limit
    ]
    sharp = [shot for shot in shots if shot.view.blur <= limit]
    return sharp, len(usable) - len(distinct), len(distinct) - len(chosen), dropped


def _place(options: CalibrateOptions, table: Path, found: Calibration) -> CameraPlace:
    """Measure the camera's pose in the world frame W from the image of the board on the table.

    Args:
        options: the board, and how it lies or stands in the image.
        table: path of the image.
        found: calibration of the lens.

    Returns:
        The pose T_world_camera (4, 4) [m], with the standard deviations of rotation [rad] and position [m].

    Raises:
        CalibrationError: the image cannot be read, has another size than the others, shows too little of the
            board, or does not fit the lens.
        ImportRefused: the image is a video that cannot be read.
    """
    image = read_image(table)
    height, width = image.shape
    if (width, height) != (found.lens.width, found.lens.height):
        raise CalibrationError(
            f"{table} has {width} x {height} px, the other images {found.lens.width} x {found.lens.height}: "
            "take it with the same camera"
        )
    sight = read_board(image, options.board)
    view = None if sight.another_layout else find_corners(image, options.board, sight)
    if view is None:
        raise CalibrationError(
            f"{table}: shows too little of the board ({counted(len(sight.tags), 'tag')}): lay it where "
            "the camera looks "
            "down on it, or stand it up, facing the camera (--upright); videos to import need no --table: "
            "`analyze import` finds the camera's pose from the object at rest"
        )
    where = STANDING if options.upright else LYING
    place = place_camera(
        image,
        view,
        options.board,
        found.lens,
        found.covariance,
        found.scatter,
        where,
        np.array(options.mark_m, dtype=float),
    )
    if place.rms_px > max(MAX_TABLE_MISFIT_PX, 4.0 * found.rms_px):
        raise CalibrationError(
            f"{table}: its corners lie {place.rms_px:.2f} px from their projection through this lens, those "
            f"of the other images {found.rms_px:.2f} px: take it with the same camera, focus and region, and "
            "the board flat"
        )
    return place
