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

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from analyze.errors import CalibrationError
from analyze.tags.mat import MAT_FAMILY, Mat, MatTag, mat_of_tag
from analyze.tracking.camera_model import distort, pixel_map, project_ideal, project_jacobian, undistort
from analyze.tracking.edges import fit_square
from analyze.tracking.marker import detect, is_marker
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from analyze.tracking.edges import Square
    from analyze.types import Array, CameraModel

MIN_TAGS = 2
"""least number of tags for a pose"""
MAX_TURN_SD, MAX_PLACE_SD = math.radians(0.3), 0.003
"""largest standard deviations of a pose, rotation [rad] and place [m]; above them it is refused"""
MODEL_PX = 0.03
"""standard deviation of a corner beside the image's noise [px]: lens, ink, edges that are not straight"""
HEIGHT_SD, HEIGHT_REACH = 1.5e-4, 0.04
"""standard deviation of the paper's height over the table [m], for a sheet that is taped flat, and the
distance over which it keeps its height [m]"""
SHEET_SD, SHEET_TURN_SD = 0.7e-3, math.radians(0.2)
"""standard deviations of a glued sheet's place [m] and turn [rad] on the middle one"""
SCALE_SD = 1e-3
"""relative standard deviation of the print's scale, by a ruler that was read to a quarter of a millimetre"""
MAX_CHI = 5.0
"""misfit of a tag's corners, in standard deviations, above which the tag is left out"""
MAX_PREDICTION_PX = 4.0
"""largest distance of a tag's corners from where the other tags predict them [px]"""
_STEPS, _TOLERANCE = 12, 1e-9
MOVED_CHI2 = 35.0
"""misfit of two poses with six numbers above which the camera was moved: one false alarm in 200 000"""
LEAST_TURN, LEAST_PLACE = math.radians(0.03), 2e-4
"""rotation [rad] and shift [m] below both of which a difference of two poses is not reported"""


@dataclass(frozen=True)
class MatView:
    """Tags of one mat in one image, or the mean of several, with their corners."""

    mat: Mat
    """the mat"""
    tags: tuple[MatTag, ...]
    """the n tags that are seen"""
    corners: Array
    """(n, 4, 2) corners, free of lens distortion [ideal px]"""
    covariance: Array
    """(n, 4, 2, 2) covariance of each corner by the image's noise [px^2]"""


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
    """Difference of two poses of one camera in W: it was moved between the images."""

    turn: float
    """angle of the rotation [rad]"""
    distance: float
    """shift of the camera's centre [m]"""
    chi2: float
    """misfit of the two poses, six numbers, by the images' noise"""
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


def mean_view(views: Sequence[MatView]) -> MatView | None:
    """Mean of several images of a camera and mat that stand still; None without any.

    Each tag's corners are averaged over the images in which it is seen, with the median's error where one of
    them differs.

    Args:
        views: the tags in each image; those of another mat than most show are not used.
    """
    if not views:
        return None
    papers = [view.mat.paper for view in views]
    layout = views[papers.index(max(papers, key=papers.count))].mat
    seen: dict[MatTag, list[tuple[Array, Array]]] = {}
    for view in views:
        if view.mat.paper == layout.paper:
            for tag, corners, covariance in zip(view.tags, view.corners, view.covariance, strict=True):
                seen.setdefault(tag, []).append((corners, covariance))
    means = [np.median([corners for corners, _ in each], axis=0) for each in seen.values()]
    spreads = [
        np.mean([covariance for _, covariance in each], axis=0) * _median_variance(len(each))
        for each in seen.values()
    ]
    return MatView(layout, tuple(seen), np.array(means), np.array(spreads))


def _median_variance(many: int) -> float:
    """Variance of the median of many values, over that of one: up to pi/2 times the mean's."""
    return (1.0 if many < 3 else 0.5 * math.pi) / many


def mat_pose(view: MatView, camera: CameraModel, scale: float = 1.0) -> MatPose:
    """Pose of the camera in W from the mat's tags, all corners in one fit.

    Args:
        view: the tags in an image, or the mean of several.
        camera: lens of the camera; its pose is not used.
        scale: length of the printed ruler over its nominal length.

    Raises:
        CalibrationError: too few tags are seen, or they leave the pose too uncertain.
    """
    kept = view
    while True:
        _refuse_few(kept, view)
        fit = _Fit(kept, camera)
        solution = fit.solve()
        worst, chi = solution.worst()
        if chi < MAX_CHI or len(kept.tags) <= MIN_TAGS:
            break
        kept = _without(kept, worst)
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
        every = before.covariance + after.covariance
        return _difference(before.T_world_camera, after.T_world_camera, every)
    parts = [_only(pose.view, common) for pose in (before, after)]
    covariance = (parts[0].covariance + parts[1].covariance) / 2
    fits = [_Fit(replace(part, covariance=covariance), camera).solve() for part in parts]
    return _difference(fits[0].T_world_camera, fits[1].T_world_camera, fits[0].noise + fits[1].noise)


def _difference(before: Array, after: Array, covariance: Array) -> CameraMove:
    """Difference of two poses (4, 4), against its covariance (6, 6)."""
    turn = Rotation.from_matrix(after[:3, :3] @ before[:3, :3].T).as_rotvec()
    shift = after[:3, 3] - before[:3, 3]
    difference = np.concatenate([turn, shift])
    chi2 = float(difference @ np.linalg.solve(covariance, difference))
    angle, distance = float(np.linalg.norm(turn)), float(np.linalg.norm(shift))
    moved = chi2 > MOVED_CHI2 and (angle > LEAST_TURN or distance > LEAST_PLACE)
    return CameraMove(angle, distance, chi2, moved)


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


@dataclass(frozen=True)
class _Solution:
    """Fitted pose with the normal equations of all unknowns."""

    T_world_camera: Array
    """(4, 4) pose [m]"""
    covariance: Array
    """(6, 6) covariance of rotation about W's axes [rad] and place [m]"""
    noise: Array
    """(6, 6) part of the images' noise"""
    chi: Array
    """(n,) misfit of each tag's corners, root mean square in standard deviations"""
    residual: Array
    """(n, 4, 2) observed less predicted corners [px]"""

    def worst(self) -> tuple[int, float]:
        """Index of the tag with the largest misfit, and the misfit [standard deviations]."""
        index = int(np.argmax(self.chi))
        return index, float(self.chi[index])


class _Fit:
    """Least squares over the camera's pose, tags' heights and glued sheets' places.

    Args:
        view: the tags seen.
        camera: lens of the camera.
    """

    def __init__(self, view: MatView, camera: CameraModel) -> None:
        self._view, self._camera = view, camera
        self._points = np.array([tag.corners for tag in view.tags])
        self._sheets = sorted({tag.sheet for tag in view.tags} - {view.mat.reference})
        self._curl = _curl(self._points.reshape(-1, 3))
        sheet = [SHEET_SD, SHEET_SD, SHEET_TURN_SD]
        self._prior = np.concatenate([np.ones(len(self._curl)), np.tile(sheet, len(self._sheets))])
        corner = view.covariance + MODEL_PX**2 * np.eye(2)
        self._root = np.linalg.cholesky(np.linalg.inv(corner)).transpose(0, 1, 3, 2)

    def solve(self) -> _Solution:
        """Fit by Gauss-Newton from the homography of all corners.

        Raises:
            CalibrationError: the corners fit no camera above the mat.
        """
        place = self._first_pose()
        extra = np.zeros(len(self._prior))
        by_all, residual, raw = self._linearise(place, extra)
        for _ in range(_STEPS):
            step = np.linalg.lstsq(by_all, residual, rcond=None)[0]
            turned = Rotation.from_rotvec(step[:3]).as_matrix() @ place[:3, :3]
            place = _transform(turned, place[:3, 3] + step[3:6])
            extra = extra + step[6:]
            by_all, residual, raw = self._linearise(place, extra)
            if float(np.max(np.abs(step))) < _TOLERANCE:
                break
        return self._solution(place, by_all, residual, raw)

    def _solution(self, T: Array, J: Array, residual: Array, raw: Array) -> _Solution:
        """Covariances at the best fit, scaled if the residuals exceed their errors."""
        inverse = np.linalg.inv(J.T @ J)
        many = residual.size - len(self._prior)
        freedom = max(1, many - 6)
        scatter = max(1.0, float(residual @ residual) / freedom)
        # What noise in the corners alone does to the pose: the gain, applied to the noise's own covariance.
        gain = (inverse @ J[:many].T)[:6]
        share = np.einsum("nkij,nkjl,nkml->nkim", self._root, self._view.covariance, self._root)
        blocks = gain.reshape(6, -1, 2)
        noise = np.einsum("ain,inm,bim->ab", blocks, share.reshape(-1, 2, 2), blocks)
        chi = np.sqrt(np.mean(residual[:many].reshape(-1, 8) ** 2, axis=1))
        return _Solution(T, inverse[:6, :6] * scatter, noise * scatter, chi, raw)

    def _first_pose(self) -> Array:
        """Pose (4, 4) of the camera in W, by the homography of all corners as if the mat were flat.

        Raises:
            CalibrationError: the corners fit no camera above the mat.
        """
        pixels = self._view.corners.reshape(-1, 2)
        homogeneous = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1)
        rays = np.linalg.solve(self._camera.K, homogeneous.T).T[:, :2]
        points = self._points.reshape(-1, 3)
        middle = points.mean(axis=0)
        count, rotations, translations, _ = cv2.solvePnPGeneric(
            points - middle, np.ascontiguousarray(rays), np.eye(3), None, flags=cv2.SOLVEPNP_IPPE
        )
        for rotation, translation in zip(rotations[:count], translations[:count], strict=True):
            R = np.asarray(cv2.Rodrigues(rotation)[0], dtype=float)
            position = middle - R.T @ np.asarray(translation, dtype=float).ravel()
            if np.all(np.isfinite(position)) and position[2] > 0:
                return _transform(R.T, position)
        raise CalibrationError(
            "the mat: its tags are not seen from above: lay it printed side up, and leave images unmirrored"
        )

    def _linearise(self, T: Array, extra: Array) -> tuple[Array, Array, Array]:
        """Whitened derivatives and residuals at a pose, priors as the last rows, and raw residuals [px].

        Args:
            T: (4, 4) pose of the camera in W.
            extra: numbers of the paper's curl, sd 1, then x, y [m] and turn [rad] of each glued sheet.
        """
        tags, many = len(self._view.tags), len(self._curl)
        points = self._points.copy()
        points[..., 2] += (self._curl @ extra[:many]).reshape(tags, 4)
        by_extra = np.zeros((tags, 4, 3, len(extra)))
        by_extra[:, :, 2, :many] = self._curl.reshape(tags, 4, many)
        for index, sheet in enumerate(self._sheets):
            at = many + 3 * index
            on = np.array([tag.sheet == sheet for tag in self._view.tags])
            arm = points[on] - [self._view.mat.middles[sheet] / 1000, 0.0, 0.0]
            turned = np.stack([-arm[..., 1], arm[..., 0], np.zeros(arm.shape[:-1])], axis=-1)
            by_extra[on, :, 0, at] = by_extra[on, :, 1, at + 1] = 1.0
            by_extra[on, :, :, at + 2] = turned
            points[on] += np.array([extra[at], extra[at + 1], 0.0]) + turned * extra[at + 2]
        R = T[:3, :3].T
        away = points - T[:3, 3]
        seen = away @ R.T
        by_point = project_jacobian(self._camera, seen) @ R
        by_turn = np.cross(away[..., None, :], np.eye(3)).transpose(0, 1, 3, 2)
        by_place = np.broadcast_to(-np.eye(3), by_turn.shape)
        J = by_point @ np.concatenate([by_turn, by_place, by_extra], axis=-1)
        raw = self._view.corners - project_ideal(self._camera, seen)
        white = (self._root @ J).reshape(-1, J.shape[-1])
        priors = np.concatenate([np.zeros((len(extra), 6)), np.diag(1 / self._prior)], axis=1)
        residual = np.concatenate([(self._root @ raw[..., None]).ravel(), -extra / self._prior])
        return np.concatenate([white, priors]), residual, raw


def _curl(points: Array) -> Array:
    """Root (n, n) of the covariance of the paper's height at n points (n, 3) [m]."""
    apart = np.sum((points[:, None, :] - points[None, :, :]) ** 2, axis=-1)
    alike = np.exp(-0.5 * apart / HEIGHT_REACH**2) + 1e-6 * np.eye(len(points))
    return np.asarray(HEIGHT_SD * np.linalg.cholesky(alike), dtype=np.float64)


def _pose(solution: _Solution, view: MatView, scale: float) -> MatPose:
    """Pose with the print's scale, and its error, applied."""
    T = solution.T_world_camera.copy()
    T[:3, 3] *= scale
    covariance = solution.covariance.copy()
    covariance[3:, 3:] += SCALE_SD**2 * np.outer(T[:3, 3], T[:3, 3])
    rms = math.sqrt(float(np.mean(np.sum(solution.residual**2, axis=-1))))
    return MatPose(T, covariance, solution.noise, view, rms)


def _without(view: MatView, index: int) -> MatView:
    """View without one of its tags."""
    return _only(view, [tag for number, tag in enumerate(view.tags) if number != index])


def _only(view: MatView, tags: Sequence[MatTag]) -> MatView:
    """View with only these of its tags, in this order."""
    where = [view.tags.index(tag) for tag in tags]
    return MatView(view.mat, tuple(tags), view.corners[where], view.covariance[where])


def _transform(R: Array, p: Array) -> Array:
    """Pose (4, 4) of a rotation (3, 3) and a place (3,)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T
