"""Pose of a printed view in one image, by grey values, from a pose nearby.

Gauss-Newton with the view's gradients (Hager and Belhumeur 1998) over the six unknowns of a rigid body, from
coarse to fine blur. The light is unknown: level, gain and their linear change over the face are fitted with
the pose. Wrong pixels (a hand, a highlight) lose their weight by Tukey's function.
"""

# numpy is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.tracking.camera_model import project_ideal, project_jacobian
from analyze.tracking.pose import marker_corners
from analyze.tracking.print_equations import Light, robust_scale, tukey_weights
from analyze.tracking.print_template import BlurredPart
from analyze.tracking.printed_view import VIEW_BLURS_PX
from analyze.tracking.rolling_shutter import row_delay_s
from analyze.tracking.turns import rotation_matrix

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.tracking.print_template import IdealImages
    from analyze.tracking.printed_view import PrintedView
    from analyze.types import Array, CameraModel

MAX_STEPS = 8
"""largest number of steps on each level of blur"""
STEPS_PER_DERIVATIVE = 3
"""number of steps after which the derivatives are computed anew"""
CONVERGED_STEP = 0.2
"""step over its standard deviation below which a level ends"""
MAX_TURN_RAD, MAX_SHIFT_M = 0.08, 0.02
"""largest step [rad, m]"""
MIN_COSINE = 0.3
"""least cosine between a point's normal and the line of sight"""
LEAST_SEEN = 100
"""number of points in view below which nothing is fitted"""
LEAST_SEEN_SHARE = 0.3
"""the same, over the view's points: with less in view the pose is poorly determined"""
MARGIN_PX = 30
"""pixels around the points that are prepared for a fit"""
MIN_BLUR_PX = 0.6
"""least blur of an image [px]: with less, grey values between pixels are wrong"""
_LEAST_GAIN, _MOST_GAIN = 0.2, 3.0
"""range of the contrast of an image over that at rest"""
_DAMPING = 1e-9
"""share of the information's trace that is added to it"""


@dataclass(frozen=True)
class Motion:
    """Velocity of a body in the camera frame, by which a rolling shutter skews its image."""

    spin: Array
    """(3,) angular velocity [rad/s]"""
    velocity: Array
    """(3,) velocity of the object frame's origin [m/s]"""


@dataclass(frozen=True)
class ViewPose:
    """Pose of the object in the camera frame by one view of its print."""

    R: Array
    """(3, 3) rotation from O to C"""
    p: Array
    """(3,) origin of O in C [m]"""
    likeness: float
    """correlation of the image's grey values with those expected, in [-1, 1]"""
    corners: Array
    """(4, 2) corners of the view's square [ideal px]"""
    corner_sd: float
    """1 sigma of a corner's coordinate, by the noise of the grey values [px]"""
    seen: int
    """number of points in view"""


@dataclass(frozen=True)
class _ViewPlacement:
    """Pose of a view in the camera frame C."""

    R: Array
    """(3, 3) rotation from O to C"""
    middle: Array
    """(3,) middle of the view's points in C [m]"""

    def moved(self, step: Array) -> _ViewPlacement:
        """Pose after a turn about the middle and a shift (6,) in C [rad, m], shortened if they are long."""
        turn, shift = float(np.linalg.norm(step[:3])), float(np.linalg.norm(step[3:]))
        step = step / max(1.0, turn / MAX_TURN_RAD, shift / MAX_SHIFT_M)
        return _ViewPlacement(rotation_matrix(step[:3]) @ self.R, self.middle + step[3:])


@dataclass(frozen=True)
class _LevelFit:
    """Fit on one level of blur."""

    placed: _ViewPlacement
    covariance: Array
    """(6, 6) of turn about the middle [rad] and shift [m], in C"""
    seen: NDArray[np.bool_]
    """(m,) True for points in view"""


class ViewFit:
    """Fit of one view of the print to images.

    Args:
        view: the print.
        camera: camera that takes the images.
    """

    def __init__(self, view: PrintedView, camera: CameraModel) -> None:
        """Prepare the terms of the light."""
        self.view, self._camera = view, camera
        self._middle = view.points.mean(axis=0)
        self._least = max(LEAST_SEEN, LEAST_SEEN_SHARE * len(view.points))
        arms = (view.points - self._middle) / max(float(np.std(view.points - self._middle)), 1e-6)
        shape = np.linalg.svd(arms, full_matrices=False)[2][:2]
        plain = np.column_stack([np.ones(len(arms)), arms @ shape.T])
        self._light = [np.column_stack([plain, 0.01 * grey[:, None] * plain]) for grey in view.grey]
        pose = view.T_object_view
        self.corners = marker_corners(view.size) @ pose[:3, :3].T + pose[:3, 3]

    def visible(self, R: Array, p: Array) -> NDArray[np.bool_]:
        """True (m,) for points in the image that face the camera, at a pose of the object in C."""
        points = self.view.points @ R.T + p
        facing = -np.sum(self.view.normals @ R.T * points, axis=1)
        pixels = project_ideal(self._camera, points)
        far = np.array([self._camera.width - 4, self._camera.height - 4])
        inside = np.all((pixels > 3) & (pixels < far), axis=1) & (points[:, 2] > 0)
        return inside & (facing > MIN_COSINE * np.linalg.norm(points, axis=1))

    def fit(
        self,
        images: IdealImages,
        image: NDArray[np.uint8],
        pose: tuple[Array, Array],
        motion: Motion | None = None,
    ) -> ViewPose | None:
        """Fit the pose to an image; None if too few points are in view or the fit is singular.

        Args:
            images: removal of the camera's distortion.
            image: (h, w) the camera's image.
            pose: rotation (3, 3) from O to C, and origin (3,) of O in C [m], to begin with.
            motion: the object's velocity, for a rolling shutter.
        """
        start = _ViewPlacement(pose[0], pose[0] @ self._middle + pose[1])
        if start.middle[2] <= 0.0 or self._in_view(start).sum() < self._least:
            return None
        part, levels = self._part(images, image, pose)
        found: _LevelFit | None = _LevelFit(start, np.eye(6), np.zeros(0, dtype=bool))
        for level in levels:
            found = self._fit_level(part, level, found.placed, motion)
            if found is None:
                return None
        placed = found.placed
        corners, by_pose = self._square(placed)
        spread = np.einsum("ij,jk,ik->i", by_pose, found.covariance, by_pose)
        return ViewPose(
            placed.R,
            self._origin(placed),
            self._likeness(part, levels[-1], found, motion),
            corners,
            float(np.sqrt(max(np.mean(spread), 0.0))),
            int(found.seen.sum()),
        )

    def _fit_level(
        self, part: BlurredPart, level: int, placed: _ViewPlacement, motion: Motion | None
    ) -> _LevelFit | None:
        """Fit on one level of blur; None if too few points are in view or the fit is singular."""
        light: Light | None = None
        seen, covariance = np.zeros(0, dtype=bool), np.eye(6)
        by, scale, correlated = np.zeros((0, 6)), 1.0, 1.0
        for turn in range(MAX_STEPS):
            if turn % STEPS_PER_DERIVATIVE == 0:
                seen, light = self._in_view(placed), None
                if seen.sum() < self._least:
                    return None
            points = self._points(placed, seen, motion)
            pixels = project_ideal(self._camera, points)
            grey = part.at(pixels, level)
            if light is None:
                correlated = _points_as_one(pixels, part.blurs[level])
                terms = self._light[level][seen]
                light = Light(terms, np.ones(len(grey)))
                off = light.residual(grey)
                light = Light(terms, tukey_weights(off, robust_scale(off)))
                scale = robust_scale(light.residual(grey))
                by = self._gain(level, seen, grey) * self._design(level, placed, points, seen)
                by = by - terms @ light.fit(by)
            off = light.residual(grey)
            weight = tukey_weights(off, robust_scale(off))
            freedom = max(len(grey) - 6 - self._light[level].shape[1], 1)
            unit = freedom / len(grey) / scale**2 / correlated
            information = unit * (by * weight[:, None]).T @ by
            information[np.diag_indices(6)] += _DAMPING * np.trace(information)
            try:
                covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
            except np.linalg.LinAlgError:
                return None
            step = covariance @ (unit * by.T @ (weight * off))
            placed = placed.moved(step)
            if not np.all(np.isfinite(placed.middle)) or placed.middle[2] <= 0.0:
                return None
            if step @ information @ step < CONVERGED_STEP**2:
                break
        return _LevelFit(placed, covariance, seen)

    def _part(
        self, images: IdealImages, image: NDArray[np.uint8], pose: tuple[Array, Array]
    ) -> tuple[BlurredPart, tuple[int, ...]]:
        """Part of an image around the points, blurred as far on the object as at rest, and levels to use."""
        points = self.view.points @ pose[0].T + pose[1]
        pixels = project_ideal(self._camera, points)
        size = np.array([self._camera.width, self._camera.height])
        last = np.maximum(size - 2 * MARGIN_PX, 0)
        low = np.clip(pixels.min(axis=0) - MARGIN_PX, 0, last).astype(int)
        high = np.clip(pixels.max(axis=0) + MARGIN_PX, np.minimum(low + 2 * MARGIN_PX, size), size).astype(
            int
        )
        scale = self._camera.K[0, 0] / float(np.mean(points[:, 2])) / self.view.px_per_m
        blurs = tuple(scale * blur for blur in VIEW_BLURS_PX)
        fine = max((n for n, blur in enumerate(blurs) if blur >= MIN_BLUR_PX), default=0)
        box = slice(low[1], high[1]), slice(low[0], high[0])
        return BlurredPart(images, image, box, blurs), tuple(range(max(fine - 1, 0), fine + 1))

    def _origin(self, placed: _ViewPlacement) -> Array:
        """Origin (3,) of O in C [m]."""
        return placed.middle - placed.R @ self._middle

    def _in_view(self, placed: _ViewPlacement) -> NDArray[np.bool_]:
        return self.visible(placed.R, self._origin(placed))

    def _points(self, placed: _ViewPlacement, seen: NDArray[np.bool_], motion: Motion | None) -> Array:
        """Points (n, 3) in C, where the rows of a rolling shutter see them."""
        points = (self.view.points[seen] - self._middle) @ placed.R.T + placed.middle
        if motion is None or not self._camera.line_time_s:
            return points
        late = row_delay_s(self._camera, project_ideal(self._camera, points)[:, 1])[:, None]
        return points + late * (motion.velocity + np.cross(motion.spin, points - self._origin(placed)))

    def _design(self, level: int, placed: _ViewPlacement, points: Array, seen: NDArray[np.bool_]) -> Array:
        """Derivatives (n, 6) of the grey values at the points by turn about the middle and shift, in C.

        A shift off the surface looks like one along it.
        """
        along, normal = self.view.slope[level][seen] @ placed.R.T, self.view.normals[seen] @ placed.R.T
        across = np.sum(along * points, axis=1) / np.sum(normal * points, axis=1)
        by_shift = along - across[:, None] * normal
        by_turn = np.cross(points - placed.middle, by_shift)
        return np.asarray(np.column_stack([by_turn, by_shift]), dtype=np.float64)

    def _gain(self, level: int, seen: NDArray[np.bool_], grey: Array) -> float:
        """Contrast of the image over that at rest."""
        rest = self.view.grey[level][seen]
        rest = rest - rest.mean()
        gain = float(rest @ (grey - grey.mean())) / max(float(rest @ rest), 1e-9)
        return min(max(gain, _LEAST_GAIN), _MOST_GAIN)

    def _likeness(self, part: BlurredPart, level: int, found: _LevelFit, motion: Motion | None) -> float:
        """Correlation of grey values with those at rest, without plain light."""
        grey = part.at(project_ideal(self._camera, self._points(found.placed, found.seen, motion)), level)
        terms = self._light[level][found.seen]
        plain = Light(terms[:, : terms.shape[1] // 2], np.ones(len(grey)))
        one, other = plain.residual(grey), plain.residual(self.view.grey[level][found.seen])
        return float(one @ other) / max(float(np.linalg.norm(one) * np.linalg.norm(other)), 1e-9)

    def _square(self, placed: _ViewPlacement) -> tuple[Array, Array]:
        """Corners (4, 2) of the view's square [ideal px], and their derivative (8, 6) by the pose."""
        arms = (self.corners - self._middle) @ placed.R.T
        points = arms + placed.middle
        into = project_jacobian(self._camera, points)
        by = np.concatenate([np.cross(arms[:, None, :], into), into], axis=2).reshape(8, 6)
        return project_ideal(self._camera, points), np.asarray(by, dtype=np.float64)


def _points_as_one(pixels: Array, blur_px: float) -> float:
    """Number of points at pixels (n, 2) that count as one, as a blur correlates their noise."""
    spread = np.cov(pixels.T)
    area = 12.0 * math.sqrt(max(float(spread[0, 0] * spread[1, 1] - spread[0, 1] ** 2), 1.0))
    return 1.0 + 4.0 * math.pi * blur_px**2 * len(pixels) / area
