"""Motion of an object by its own print, frame by frame: template and image are compared as grey values.

Gauss-Newton with the template's gradients (Hager and Belhumeur 1998; Baker and Matthews 2004) over six
unknowns of the body per frame, on two levels of blur. On each face the light is unknown: gain, level and a
linear gradient are fitted with the pose, and drop out. Wrong pixels (a hand, a shadow, a highlight) lose
their weight by Tukey's function.
"""

# numpy is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.tracking.camera_model import project_ideal, world_to_camera
from analyze.tracking.print_equations import (
    LEAST_NOISE,
    Light,
    PrintEquations,
    contrast,
    light_terms,
    robust_scale,
    tukey_weights,
)
from analyze.tracking.print_template import BLURS_PX, BlurredPart, by_rest_pose
from analyze.tracking.rolling_shutter import row_delay_s

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.tracking.print_template import IdealImages, PrintTemplate
    from analyze.types import Array, CameraModel

THETA, ROLL, YAW, X, Y, Z = range(6)
"""places of a frame's unknowns: tip about W's y, turns about W's x and z [rad], shift of the pivot [m]"""
PRIOR_SD = np.array([np.inf, np.radians(0.05), np.radians(0.5), 5e-3, 1.5e-3, 3e-3])
"""1 sigma of the unknowns about a pure tip: a camera that looks along the edge hardly sees roll, yaw and y"""
_PRIOR = PRIOR_SD**-2.0
_ITERATIONS = (6, 6)
"""largest number of steps on each level"""
_RENEWED = 3
"""number of steps after which the derivatives are computed anew"""
_CONVERGED = 0.25
"""step over its standard deviation below which a level ends"""
_LARGEST_STEP = np.array([0.05, 0.01, 0.02, 0.004, 0.004, 0.004])
"""largest change of the unknowns in one step [rad, m]"""
CORRELATED = (20.0, 3.0)
"""number of points that count as one, as the blur correlates their noise, on each level"""
_SEARCH_BELOW, _DROPPED_BELOW = 0.8, 0.9
"""mean weight of the points, over the usual one and over the frame before, below which other tips are tried:
where stripes match beside the print it drops"""
_SEARCH_RAD, _SEARCH_STEP_RAD = (-0.064, 0.128), 0.008
"""range of tips that are tried, against the predicted one, and their spacing [rad]"""
_TRIED = 3
"""number of the best of these that are fitted"""
_LOST_BELOW = 0.6
"""mean weight of the points, over the usual one, below which a frame has no fit"""
_LEAST_STRENGTH = 2.0
"""gradient from which on a point is print [grey/px]: shades of a facetted wall have less"""
_GRAINS = 1.7
"""the same over the grain that all images at rest share, whose own gradients have up to 1.6"""
_LEAST_GAIN = 0.3
"""contrast of the print over that at rest below which nothing is explained: on an even background it is 0"""
_STEEPEST = 0.15
"""least cosine of the angle between a point's normal and the line of sight"""
_LEAST_SEEN = 40
"""number of points in view, beyond the terms of the light, below which nothing is fitted"""
_LEAST_SHARE = 0.25
"""the same over the number of the template's points: at the image's border a few points fit anywhere"""
_NOISES = 3.0
"""residual over the noise, for a print without contrast, from which on a point is not explained"""
_MARGIN_PX, _SEARCH_MARGIN_PX = 24, 90
"""pixels around the points that are prepared for a fit, and for a search"""
_OPEN_SD = np.array([1.0, 0.1, 0.1, 0.05, 0.05, 0.05])
"""1 sigma of the unknowns of a frame without a fit [rad, m]"""


@dataclass(frozen=True)
class PrintPose:
    """Unknowns of one frame, fitted to its image."""

    x: Array
    """(6,) unknowns, as in `THETA` to `Z`"""
    covariance: Array
    """(6, 6) their covariance, from the noise of the pixels and the priors"""
    explained: float
    """mean of `explained_points`, 1 where all fit"""
    pixels: Array
    """(m, 2) ideal pixels of the template's points"""
    explained_points: Array
    """(m,) share of each point's grey value that is explained, 0 to 1; NaN out of view"""
    shared: tuple[Array, Array]
    """information (3, 3) and gradient (3,) about the rest pose: turn about W's z [rad], shift along x and y
    [m], with the frame's own unknowns fitted"""
    by_rest: Array
    """(6, 3) change of the unknowns by the rest pose"""


@dataclass(frozen=True)
class _Placed:
    """Points of the template at given unknowns."""

    turns: tuple[Array, Array, Array]
    """matrices (3, 3) of tip, roll and yaw"""
    arms: Array
    """points (m, 3) about the pivot, turned [m]"""
    points: Array
    """(m, 3) points in W [m]"""
    pixels: Array
    """(m, 2) ideal pixels"""

    @property
    def whole(self) -> Array:
        """Matrix (3, 3) of all turns."""
        tip, roll, yaw = self.turns
        return yaw @ roll @ tip


class PrintFollower:
    """Tracker of one strike's frames by a template.

    Args:
        template: points and grey values at rest.
        camera: camera with its pose in W.
        images: removal of the camera's distortion.
        pivot: (3,) point of the pivot's centre line at rest, in W [m].
        radius: radius of the edge's rounding [m], on which the body rolls.
        interval_s: time from frame to frame [s], for a rolling shutter.
    """

    def __init__(
        self,
        template: PrintTemplate,
        camera: CameraModel,
        images: IdealImages,
        pivot: Array,
        radius: float,
        interval_s: float = 0.0,
    ) -> None:
        """Prepare the tracker; the first frame is expected at rest."""
        self._template, self._camera, self._images = template, camera, images
        self.sees_round_walls = template.is_round
        """True if shades move over the faces with print"""
        self._pivot, self._radius = pivot, radius
        self._interval_s, self._rate = interval_s, 0.0
        self._arms = template.points - pivot
        self._slope = template.slope.mean(axis=0)
        self._by_rest = by_rest_pose(template, camera, pivot)
        self._light = [light_terms(grey, template.waves, template.face) for grey in template.grey]
        self._contrast = [contrast(grey, template.waves, template.face) for grey in template.grey]
        self._limits = [
            math.hypot(float(np.std(contrast_)), _NOISES * max(noise, LEAST_NOISE))
            for contrast_, noise in zip(self._contrast, template.noise, strict=True)
        ]
        self._even_lights: dict[int, tuple[NDArray[np.bool_], Light]] = {}
        """the last points in view and their light, by level"""
        self._R, self._t = world_to_camera(camera)
        self._x, self._speed, self._missed = np.zeros(6), 0.0, 1
        self._usual = self._last = 0.9

    def add(
        self, image: NDArray[np.uint8], start: Array | None = None, rate: float | None = None
    ) -> PrintPose:
        """Fit the next frame's pose.

        If the prediction leads to no fit, as in the frame after a blow, the coarse level and tips around the
        prediction are tried. A frame without a fit does not change what is predicted for the next.

        Args:
            image: the camera's image.
            start: (6,) unknowns to begin with; None to predict them from the frames before.
            rate: angular velocity [rad/s], by which a rolling shutter skews the image; None for that of the
                frames before.
        """
        if rate is None:
            rate = self._speed / self._interval_s if self._interval_s else 0.0
        self._rate = rate
        if start is None:
            start = self._x * np.array([1.0, 0.9, 0.9, 0.9, 0.9, 0.9])
            start[THETA] += self._speed
        least = max(_SEARCH_BELOW * self._usual, _DROPPED_BELOW * min(self._usual, self._last))
        view = self._view(image, start, _MARGIN_PX)
        pose = self._fit(view, start, len(BLURS_PX) - 1)
        if pose.explained < least:
            pose = max(pose, self._levels(view, start), key=_explained)
        if pose.explained < least:
            pose = self._searched(image, start, pose, least)
        self._last = pose.explained
        if pose.explained >= least:
            self._usual += 0.1 * (pose.explained - self._usual)
        if pose.explained >= _LOST_BELOW * self._usual:
            self._speed = float(pose.x[THETA] - self._x[THETA]) / self._missed
            self._x, self._missed = pose.x, 1
        else:
            self._missed += 1
        return pose

    def _searched(self, image: NDArray[np.uint8], start: Array, pose: PrintPose, least: float) -> PrintPose:
        """Best of `pose` and the fits from the tips that look most like the image."""
        view = self._view(image, start, _SEARCH_MARGIN_PX)
        low, high = _SEARCH_RAD
        # A landing stops the body at once: back to where it was.
        tips = np.arange(low - abs(self._speed) * self._missed, high, _SEARCH_STEP_RAD)
        tried = start + np.outer(tips, np.eye(6)[THETA])
        order = np.argsort([self._misfit(view, each) for each in tried])
        for number in order[:_TRIED]:
            pose = max(pose, self._levels(view, tried[number]), key=_explained)
            if pose.explained >= least:
                break
        return pose

    def _view(self, image: NDArray[np.uint8], x: Array, margin: int) -> BlurredPart:
        """Part of an image around the points at given unknowns."""
        pixels = self._placed(x).pixels
        size = np.array([self._camera.width, self._camera.height])
        low = np.clip(pixels.min(axis=0) - margin, 0, size - 2 * margin).astype(int)
        high = np.clip(pixels.max(axis=0) + margin, low + 2 * margin, size).astype(int)
        return BlurredPart(self._images, image, (slice(low[1], high[1]), slice(low[0], high[0])))

    def _levels(self, view: BlurredPart, start: Array) -> PrintPose:
        """Fit from a start, level by level."""
        pose = self._fit(view, start, 0)
        for level in range(1, len(BLURS_PX)):
            pose = self._fit(view, pose.x, level)
        return pose

    def _misfit(self, view: BlurredPart, x: Array) -> float:
        """Robust scale of the coarse residuals at given unknowns [grey]."""
        placed = self._placed(x)
        seen = self._seen(placed)
        if seen.sum() < _LEAST_SEEN:
            return np.inf
        grey = view.at(placed.pixels[seen], 0)
        off = self._even_light(0, seen).residual(grey)
        return float(np.median(np.abs(off))) / max(self._gain(0, seen, grey), 0.05)

    def _gain(self, level: int, seen: NDArray[np.bool_], grey: Array) -> float:
        """Contrast of the print in grey values (n,) of the points in view, over that at rest."""
        at_rest = self._contrast[level][seen]
        return float(at_rest @ grey) / max(float(at_rest @ at_rest), 1e-9)

    def _even_light(self, level: int, seen: NDArray[np.bool_]) -> Light:
        """Light with equal weights at the points in view."""
        kept = self._even_lights.get(level)
        if kept is None or not np.array_equal(kept[0], seen):
            kept = seen, Light(self._light[level][seen], np.ones(int(seen.sum())))
            self._even_lights[level] = kept
        return kept[1]

    def _fit(self, view: BlurredPart, start: Array, level: int) -> PrintPose:
        x, seen = start.copy(), np.zeros(0, dtype=bool)
        light: Light | None = None
        system: PrintEquations | None = None
        grey, off, shared, unit, inflation = np.zeros(0), np.zeros(0), np.zeros(3), 0.0, 1.0
        pixels = np.zeros((0, 2))
        for turn in range(_ITERATIONS[level]):
            placed = self._placed(x)
            if turn % _RENEWED == 0:
                light, seen = None, self._seen(placed)
                freedom = int(seen.sum()) - self._light[level].shape[1]
                if freedom < max(_LEAST_SEEN, _LEAST_SHARE * len(seen)):
                    return _open(start, placed.pixels)
                # Residuals are smaller than the errors by what the fitted light takes up.
                inflation = math.sqrt(seen.sum() / freedom)
            pixels = placed.pixels
            grey = view.at(pixels[seen], level)
            if light is None:
                off = self._even_light(level, seen).residual(grey)
                light = Light(self._light[level][seen], tukey_weights(off, robust_scale(off)))
                off = light.residual(grey)
                scale = robust_scale(off)
                weight = tukey_weights(off, scale)
                unit = 1.0 / (inflation * scale) ** 2 / CORRELATED[level]
                system = PrintEquations.of(
                    self._design(placed, self._slope[level])[seen], light, unit, _PRIOR
                )
            else:
                off = light.residual(grey)
                weight = tukey_weights(off, robust_scale(off))
            if system is None:
                return _open(start, pixels)
            step, shared = system.step(unit * weight * off, x)
            x = x + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)
            if step @ system.information @ step < _CONVERGED**2:
                break
        if system is None or not np.all(np.isfinite(x)):
            return _open(start, pixels)
        points = np.full(len(seen), np.nan)
        points[seen] = np.clip(1.0 - (inflation * off / self._limits[level]) ** 2, 0.0, None) ** 2
        points[seen] *= self._gain(level, seen, grey) > _LEAST_GAIN
        mean = float(np.mean(points[seen]))
        information = system.shared, shared
        return PrintPose(x, system.covariance, mean, pixels, points, information, system.by_rest)

    def on_main_face(self, pixels: Array) -> Array:
        """Points (k, 3) at rest in W at (k, 2) ideal pixels, on the plane of the face with most points."""
        template, eye = self._template, self._camera.T_world_camera[:3, 3]
        main = template.face == np.bincount(template.face).argmax()
        normal, middle = template.normals[main].mean(axis=0), template.points[main].mean(axis=0)
        rays = np.column_stack([pixels, np.ones(len(pixels))]) @ np.linalg.inv(self._camera.K).T
        rays = rays @ self._camera.T_world_camera[:3, :3].T
        return np.asarray(eye + rays * ((middle - eye) @ normal / (rays @ normal))[:, None], dtype=np.float64)

    def moved(self, x: Array, points: Array | None = None) -> Array:
        """Ideal pixels (k, 2) at unknowns `x` (6,) of the template's points, or of (k, 3) at rest in W."""
        return self._placed(x, None if points is None else points - self._pivot).pixels

    def _placed(self, x: Array, arms: Array | None = None) -> _Placed:
        """Points of the template, or at other arms (k, 3) from the pivot, at the unknowns `x` (6,)."""
        c, s = np.cos(x[:3]), np.sin(x[:3])
        tip = np.array([[c[0], 0, s[0]], [0, 1, 0], [-s[0], 0, c[0]]])
        roll = np.array([[1, 0, 0], [0, c[1], -s[1]], [0, s[1], c[1]]])
        yaw = np.array([[c[2], -s[2], 0], [s[2], c[2], 0], [0, 0, 1]])
        arms = (self._arms if arms is None else arms) @ (yaw @ roll @ tip).T
        points = arms + (self._pivot + x[X:] + np.array([self._radius * x[THETA], 0.0, 0.0]))
        pixels = project_ideal(self._camera, points @ self._R.T + self._t)
        if self._rate and self._camera.line_time_s:
            # Each row is read out at its own time.
            late = self._rate * row_delay_s(self._camera, pixels[:, 1])
            points[:, 0] += late * (arms[:, 2] + self._radius)
            points[:, 2] -= late * arms[:, 0]
            pixels = project_ideal(self._camera, points @ self._R.T + self._t)
        return _Placed((tip, roll, yaw), arms, points, pixels)

    def _seen(self, placed: _Placed) -> NDArray[np.bool_]:
        """True (m,) for points in the image that face the camera."""
        sight = placed.points - self._camera.T_world_camera[:3, 3]
        normals = self._template.normals @ placed.whole.T
        facing = -np.einsum("ni,ni->n", normals, sight) > _STEEPEST * np.linalg.norm(sight, axis=1)
        far = np.array([self._camera.width - 3, self._camera.height - 3])
        return facing & np.all((placed.pixels > 2) & (placed.pixels < far), axis=1)

    def _design(self, placed: _Placed, slope: Array) -> Array:
        """Derivatives (m, 9) of the image's grey values at the points.

        They are by the frame's unknowns (6), then by the pose at rest (3): the object turned and shifted at
        rest, with its edge, and the points on their lines of sight.

        Args:
            placed: points at the present unknowns.
            slope: (m, 3) gradient along the surface at rest, in W [grey/m].
        """
        tip, roll, yaw = placed.turns
        whole = placed.whole
        normal, along = self._template.normals @ whole.T, slope @ whole.T
        # A shift off the surface looks like one along it.
        sight = placed.points - self._camera.T_world_camera[:3, 3]
        across = np.einsum("ni,ni->n", along, sight) / np.einsum("ni,ni->n", normal, sight)
        by_shift = along - across[:, None] * normal
        tipped = self._arms @ tip.T
        rolled, turned = tipped @ roll.T, placed.arms
        design = np.empty((len(slope), 9))
        by_tip, by_roll = by_shift @ (yaw @ roll), by_shift @ yaw
        design[:, THETA] = tipped[:, 2] * by_tip[:, 0] - tipped[:, 0] * by_tip[:, 2]
        design[:, THETA] += self._radius * by_shift[:, 0]
        design[:, ROLL] = rolled[:, 1] * by_roll[:, 2] - rolled[:, 2] * by_roll[:, 1]
        design[:, YAW] = turned[:, 0] * by_shift[:, 1] - turned[:, 1] * by_shift[:, 0]
        design[:, X:6] = by_shift
        design[:, 6] = design[:, YAW]
        design[:, 7:] = by_shift[:, :2]
        design[:, 6:] += np.einsum("ni,nij->nj", by_shift @ whole, self._by_rest)
        return design

    def theta_sd(self) -> float:
        """Predicted standard deviation of theta in one frame at rest [rad]; infinite for a blank face.

        Only what both halves of the images show counts as print.
        """
        placed, level = self._placed(np.zeros(6)), len(BLURS_PX) - 1
        least = max(_LEAST_STRENGTH, _GRAINS * self._template.grain)
        strong = self._seen(placed) & (self._template.strength > least)
        if strong.sum() < _LEAST_SEEN:
            return math.inf
        one, other = (self._design(placed, half[level])[strong, :6] for half in self._template.slope)
        light = Light(self._light[level][strong], np.ones(int(strong.sum())))
        row = 1.0 / max(self._template.noise[level], LEAST_NOISE) ** 2 / CORRELATED[level]
        free = [each - light.terms @ light.fit(each) for each in (one, other)]
        common = row * (free[0].T @ free[1])
        information = 0.5 * (common + common.T)
        print_, prior = information[THETA, THETA], np.diag(_PRIOR)
        if print_ <= 0.0 or np.linalg.eigvalsh(information[1:, 1:] + prior[1:, 1:]).min() <= 0.0:
            return math.inf
        rest = np.linalg.solve(information[1:, 1:] + prior[1:, 1:], information[1:, THETA])
        left = print_ - float(information[THETA, 1:] @ rest)
        return 1.0 / math.sqrt(left) if left > 0.0 else math.inf


def _open(start: Array, pixels: Array) -> PrintPose:
    """Pose of a frame without a fit."""
    nothing, unseen = (np.zeros((3, 3)), np.zeros(3)), np.full(len(pixels), np.nan)
    return PrintPose(start, np.diag(_OPEN_SD**2), 0.0, pixels, unseen, nothing, np.zeros((6, 3)))


def _explained(pose: PrintPose) -> float:
    return pose.explained
