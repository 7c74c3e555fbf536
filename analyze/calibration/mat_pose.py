"""Pose of the camera in the world frame W from the tags of the mat, and whether the camera was moved since.

All corners are fitted together. Unknown are, beside the pose, the paper's height over the table at each
corner (a random surface), and the place of each glued sheet on the middle one; all have priors, so that the
pose's covariance contains what they leave open. The print's scale is added to it: a mat that is s times too
large puts the camera s times too far from W's origin, and leaves its rotation.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.calibration.mat_fit import MatFit, MatSolution
from analyze.calibration.mat_view import MatView, only_tags, view_shift, without_tag
from analyze.errors import CalibrationError
from analyze.tags.mat import MAT_FAMILY, Mat, MatTag, mat_of_tag
from analyze.tracking.camera_model import distort, pixel_map, project_ideal, undistort
from analyze.tracking.edges import fit_square
from analyze.tracking.marker import detect, is_marker
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from analyze.tracking.edges import Square
    from analyze.types import Array, CameraModel

MIN_TAGS = 2
"""least number of tags for a pose"""
MAX_TURN_SD, MAX_PLACE_SD = math.radians(0.3), 0.003
"""largest standard deviations of a pose, rotation [rad] and place [m]; above them it is refused"""
SCALE_SD = 1e-3
"""relative standard deviation of the print's scale, by a ruler that was read to a quarter of a millimetre"""
MAX_SCALE_ERROR = 0.1
"""largest relative difference of a print from its nominal size that is taken for meant"""
MAX_CHI = 5.0
"""misfit of a tag's corners, in standard deviations, above which the tag is left out"""
MAX_PREDICTION_PX = 4.0
"""largest distance of a tag's corners from where the other tags predict them [px]"""
MOVED_CHI2 = 35.0
"""misfit of two poses with six numbers above which the camera was moved: one false alarm in 200 000"""
LEAST_TURN, LEAST_PLACE = math.radians(0.03), 2e-4
"""rotation [rad] and shift [m] below both of which a difference of two poses is not reported"""


@dataclass(frozen=True)
class MatPose:
    """Pose of the camera in W by a mat, with its covariance."""

    T_world_camera: Array
    """(4, 4) pose of the camera in W, translation in m"""
    covariance: Array
    """(6, 6) covariance of the rotation about W's axes [rad] and the place in W [m], from all errors"""
    noise: Array
    """(6, 6) the part of it that the image's noise makes, which differs from image to image"""
    view: MatView
    """the tags that it comes from, without those left out"""
    rms_px: float
    """root mean square distance of the corners from their predictions [px]"""

    @property
    def turn_sd(self) -> Array:
        """Standard deviations (3,) of the rotation about W's axes [rad]."""
        return np.sqrt(np.diag(self.covariance)[:3])

    @property
    def position_sd(self) -> Array:
        """Standard deviations (3,) of the place along W's axes [m]."""
        return np.sqrt(np.diag(self.covariance)[3:])


@dataclass(frozen=True)
class CameraMove:
    """Difference of a camera's place in two images of one mat."""

    turn: float
    """angle of the rotation [rad]; NaN if a pose is unknown"""
    distance: float
    """shift of the camera's centre [m]; NaN if a pose is unknown"""
    pixels: float
    """shift of the tags in the image [px]; 0 within the noise, or if the images share no tag"""
    chi2: float
    """misfit of the two poses, six numbers, by the images' noise; NaN if a pose is unknown"""
    moved: bool
    """True if the difference exceeds the errors"""


def read_mat(image: NDArray[np.uint8], camera: CameraModel) -> MatView | None:
    """Find the mat's tags in an image, and fit their edges; None if none is seen.

    If tags of several mats are seen, the mat with most of them is taken. A tag that is seen twice is left
    out. Once `MIN_TAGS` are found, the others are looked for where these predict them, so that tags too small
    or too slanted to be detected are used as well.

    Args:
        image: (height, width) grey values.
        camera: lens of the camera; its pose is not used.
    """
    sights = [sight for sight in detect(image, (MAT_FAMILY,)) if mat_of_tag(sight.marker_id) is not None]
    names = [sight.marker_id for sight in sights]
    mats = [mat_of_tag(name) for name in names]
    if not sights:
        return None
    layout = max(filter(None, mats), key=mats.count)
    pixels = pixel_map(camera)
    by_name = {tag.name: tag for tag in layout.tags}
    found: dict[MatTag, Square] = {}
    for sight in sights:
        if sight.marker_id not in by_name or names.count(sight.marker_id) > 1:
            continue
        square = fit_square(image, pixels, undistort(camera, sight.corners_px), sight.corners_px)
        if square is not None:
            found[by_name[sight.marker_id]] = square
    view = _view(layout, found)
    if view is None or len(found) < MIN_TAGS:
        return view
    try:
        pose = mat_pose(view, camera)
    except CalibrationError:
        return view
    for tag in layout.tags:
        if tag not in found and (square := _predicted_tag(image, camera, pose, tag)) is not None:
            found[tag] = square
    return _view(layout, found)


def _view(layout: Mat, found: Mapping[MatTag, Square]) -> MatView | None:
    """Tags of a mat with their fitted corners; None if there is none."""
    if not found:
        return None
    corners = np.array([square.corners for square in found.values()])
    return MatView(layout, tuple(found), corners, np.array([square.covariance for square in found.values()]))


def _predicted_tag(
    image: NDArray[np.uint8], camera: CameraModel, pose: MatPose, tag: MatTag
) -> Square | None:
    """Corners of a tag where the pose by the others predicts it; None if its code is not seen there."""
    T = pose.T_world_camera
    away = (tag.corners - T[:3, 3]) @ T[:3, :3]
    if float(away[:, 2].min()) <= 0.0:
        return None
    expected = project_ideal(camera, away)
    raw = distort(camera, expected)
    if np.any(raw < 0) or np.any(raw > [camera.width - 1, camera.height - 1]):
        return None
    square = fit_square(image, pixel_map(camera), expected, raw)
    if square is None or float(np.abs(square.corners - expected).max()) > MAX_PREDICTION_PX:
        return None
    return square if is_marker(image, distort(camera, square.corners), tag.name) else None


def mat_pose(view: MatView, camera: CameraModel, ruler_mm: float | None = None) -> MatPose:
    """Pose of the camera in W from the mat's tags, all corners in one fit.

    Args:
        view: the tags in an image, or the mean of several.
        camera: lens of the camera; its pose is not used.
        ruler_mm: length of the ruler on the pivot line as measured [mm]; None for the nominal one.

    Raises:
        CalibrationError: too few tags are seen, they leave the pose too uncertain, or the ruler is stated to
            be of another length by a tenth or more.
    """
    kept = view
    while True:
        _refuse_few(kept, view)
        fit = MatFit(kept, camera)
        solution = fit.solve()
        worst, chi = solution.worst()
        if chi < MAX_CHI or len(kept.tags) <= MIN_TAGS:
            break
        kept = without_tag(kept, worst)
    scale = 1.0 if ruler_mm is None else ruler_mm / kept.mat.ruler_mm
    if not abs(scale - 1.0) < MAX_SCALE_ERROR:
        raise CalibrationError(
            f"the mat's ruler is stated to be {ruler_mm:g} mm long, on the {kept.mat.paper} mat it is "
            f"{kept.mat.ruler_mm:g} mm: measure the one on the pivot line, between its outermost numbers"
        )
    pose = _pose(solution, kept, scale)
    turn, place = float(pose.turn_sd.max()), float(pose.position_sd.max())
    if turn > MAX_TURN_SD or place > MAX_PLACE_SD or chi >= MAX_CHI:
        raise CalibrationError(
            f"the mat: {counted(len(kept.tags), 'tag')} seen leave the camera's pose uncertain by "
            f"{math.degrees(turn):.2f} deg and {1000 * place:.1f} mm: raise the camera, or move it nearer, "
            "until it sees tags on both sides of the pivot line, or print a larger mat"
        )
    return pose


def camera_move(before: MatPose, after: MatPose, camera: CameraModel) -> CameraMove | None:
    """Difference of a camera's poses in two images of one mat; None if they show different mats.

    Both poses are fitted anew to the tags that both images show. The errors of paper, print and glue are then
    the same in both, and cancel, so that the images' noise remains. With too few tags in common the poses are
    compared as they are, by all their errors.

    Args:
        before: pose by the earlier image.
        after: pose by the later image.
        camera: lens of the camera.
    """
    common = [tag for tag in before.view.tags if tag in after.view.tags]
    if before.view.mat.paper != after.view.mat.paper:
        return None
    if len(common) < MIN_TAGS:
        every, pixels = before.covariance + after.covariance, view_shift(before.view, after.view)
        return _difference(before.T_world_camera, after.T_world_camera, every, pixels)
    parts = [only_tags(pose.view, common) for pose in (before, after)]
    covariance = (parts[0].covariance + parts[1].covariance) / 2
    fits = [MatFit(replace(part, covariance=covariance), camera).solve() for part in parts]
    noise = fits[0].noise + fits[1].noise
    return _difference(fits[0].T_world_camera, fits[1].T_world_camera, noise, view_shift(*parts))


def _difference(before: Array, after: Array, covariance: Array, pixels: float | None) -> CameraMove:
    """Difference of two poses (4, 4), against its covariance (6, 6), with the tags' shift [px]."""
    difference = pose_difference(before, after)
    chi2 = float(difference @ np.linalg.solve(covariance, difference))
    angle, distance = float(np.linalg.norm(difference[:3])), float(np.linalg.norm(difference[3:]))
    moved = chi2 > MOVED_CHI2 and (angle > LEAST_TURN or distance > LEAST_PLACE)
    return CameraMove(angle, distance, pixels or 0.0, chi2, moved or bool(pixels))


def pose_difference(before: Array, after: Array) -> Array:
    """Difference (6,) of two poses (4, 4) of a camera in W: rotation vector in W [rad], shift [m]."""
    turn = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec()
    return np.concatenate([np.asarray(turn, dtype=np.float64), after[:3, 3] - before[:3, 3]])


def unposed_move(before: MatView, after: MatView) -> CameraMove | None:
    """Move of a camera by the tags' shift alone, where a pose is unknown; None if the views share no tag.

    Args:
        before: tags in the earlier image.
        after: tags in the later image.
    """
    pixels = view_shift(before, after)
    return None if pixels is None else CameraMove(math.nan, math.nan, pixels, math.nan, pixels > 0.0)


def _refuse_few(kept: MatView, view: MatView) -> None:
    """Check that enough tags are left.

    Raises:
        CalibrationError: they are too few.
    """
    if len(kept.tags) < MIN_TAGS:
        left_out = len(view.tags) - len(kept.tags)
        why = f", {left_out} more do not fit them" if left_out else ""
        raise CalibrationError(
            f"the mat: {counted(len(kept.tags), 'tag', 'is')} seen{why}, {MIN_TAGS} are needed: raise the "
            "camera, or move it nearer, until it sees tags on both sides of the pivot line; light them evenly"
        )


def _pose(solution: MatSolution, view: MatView, scale: float) -> MatPose:
    """Pose with the print's scale, and its error, applied."""
    T = solution.T_world_camera.copy()
    T[:3, 3] *= scale
    covariance = solution.covariance.copy()
    covariance[3:, 3:] += SCALE_SD**2 * np.outer(T[:3, 3], T[:3, 3])
    squares: Array = np.asarray(np.sum(solution.residual**2, axis=-1), dtype=np.float64)
    rms = math.sqrt(float(np.mean(squares)))
    return MatPose(T, covariance, solution.noise, view, rms)
