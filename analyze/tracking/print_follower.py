"""Motion of an object by its own print, frame by frame: template and image are compared as grey values.

Forward Gauss-Newton (Lucas and Kanade 1981, in the form of Baker and Matthews 2004) over six unknowns of the
body per frame, on two levels of blur. On each face the light is unknown: gain, level and a linear gradient
are fitted with the pose, and drop out. Wrong pixels (a hand, a shadow, a highlight) lose their weight by
Tukey's function.
"""

# numpy and cv2 are only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.tracking.camera_model import project_ideal, project_jacobian, world_to_camera
from analyze.tracking.print_template import BLURS_PX, IdealImages, PrintTemplate, blurred, gradients

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.types import Array, CameraModel

THETA, ROLL, YAW, X, Y, Z = range(6)
"""places of a frame's unknowns: tip about W's y, turns about W's x and z [rad], shift of the pivot [m]"""
PRIOR_SD = np.array([np.inf, np.radians(0.05), np.radians(0.5), 5e-3, 1.5e-3, 3e-3])
"""1 sigma of the unknowns about a pure tip: a camera that looks along the edge hardly sees roll, yaw and y"""
_ITERATIONS = (4, 6)
"""number of steps on each level"""
_LARGEST_STEP = np.array([0.05, 0.01, 0.02, 0.004, 0.004, 0.004])
"""largest change of the unknowns in one step [rad, m]"""
_TUKEY = 5.0
"""residual over its robust scale at which a pixel loses its weight"""
_CORRELATED = (20.0, 3.0)
"""number of points that count as one, as the blur correlates their noise, on each level"""
_SEARCH_BELOW = 0.85
"""mean weight of the points, over the usual one, below which other tips are tried"""
_SEARCHED_RAD = np.concatenate([np.arange(-8, 0), np.arange(1, 17)]) * 0.008
"""tips that are tried, against the predicted one [rad]"""
_TRIED = 3
"""number of the best of these that are fitted"""
_LOST_BELOW = 0.6
"""mean weight of the points, over the usual one, below which a frame has no fit"""
_LEAST_SEEN = 40
"""number of points in view below which nothing is fitted"""
_BLURRED = 2.0
"""factor on the noise at rest up to which a moving frame's residuals count as explained"""
_OPEN_SD = np.array([1.0, 0.1, 0.1, 0.05, 0.05, 0.05])
"""1 sigma of the unknowns of a frame without a fit [rad, m]"""
_LEAST_NOISE = 0.6
"""least robust scale of the residuals [grey]"""


@dataclass(frozen=True)
class PrintPose:
    """Unknowns of one frame, fitted to its image."""

    x: Array
    """(6,) unknowns, as in `THETA` to `Z`"""
    covariance: Array
    """(6, 6) their covariance, from the noise of the pixels and the priors"""
    residual: float
    """robust scale of the residuals [grey]"""
    explained: float
    """mean weight of the points, 1 where all fit"""
    shared: tuple[Array, Array]
    """information (3, 3) and gradient (3,) about the rest pose: turn about W's z [rad], shift along x and y
    [m], with the frame's own unknowns fitted"""


class PrintFollower:
    """Tracker of one strike's frames by a template.

    Args:
        template: points and grey values at rest.
        camera: camera with its pose in W.
        pivot: (3,) point of the pivot's centre line at rest, in W [m].
        radius: radius of the edge's rounding [m], on which the body rolls.
    """

    def __init__(self, template: PrintTemplate, camera: CameraModel, pivot: Array, radius: float) -> None:
        """Prepare the tracker; the first frame is expected at rest."""
        self._template, self._camera = template, camera
        self._pivot, self._radius = pivot, radius
        self._images = IdealImages(camera)
        self._arms = template.points - pivot
        self._by_rest = _by_rest_pose(template, camera, pivot)
        self._R, self._t = world_to_camera(camera)
        self._x, self._speed, self._usual, self._missed = np.zeros(6), 0.0, 0.9, 1
        self._noise = _LEAST_NOISE

    def add(self, image: NDArray[np.uint8]) -> PrintPose:
        """Fit the next frame's pose.

        If the prediction leads to no fit, as in the frame after a blow, the coarse level and tips around the
        prediction are tried. A frame without a fit does not change what is predicted for the next.
        """
        ideal = self._images.ideal(image)
        start = self._x * np.array([1.0, 0.9, 0.9, 0.9, 0.9, 0.9])
        start[THETA] += self._speed
        least = _SEARCH_BELOW * self._usual
        pose = self._fit(ideal, start, len(BLURS_PX) - 1)
        if pose.explained < least:
            pose = max(pose, self._levels(ideal, start), key=_explained)
        if pose.explained < least:
            coarse = blurred(ideal, BLURS_PX[0])
            tried = start + np.outer(_SEARCHED_RAD, np.eye(6)[THETA])
            order = np.argsort([self._misfit(coarse, each) for each in tried])
            for number in order[:_TRIED]:
                pose = max(pose, self._levels(ideal, tried[number]), key=_explained)
                if pose.explained >= least:
                    break
        if pose.explained >= least:
            self._usual += 0.1 * (pose.explained - self._usual)
        if pose.explained >= _LOST_BELOW * self._usual:
            self._speed = float(pose.x[THETA] - self._x[THETA]) / self._missed
            self._x, self._missed = pose.x, 1
        else:
            self._missed += 1
        return pose

    def _levels(self, ideal: NDArray[np.float32], start: Array) -> PrintPose:
        """Fit from a start, level by level."""
        pose = self._fit(ideal, start, 0)
        for level in range(1, len(BLURS_PX)):
            pose = self._fit(ideal, pose.x, level)
        return pose

    def _misfit(self, image: NDArray[np.float32], x: Array) -> float:
        """Robust scale of the coarse residuals at given unknowns [grey]."""
        pixels, _, facing = self._projected(x)
        inside = facing & np.all((pixels > 2) & (pixels < self._far), axis=1)
        grey = _sample(image, pixels[inside].astype(np.float32))
        return self._without_light(grey, 0, inside)[3] if inside.sum() > _LEAST_SEEN else np.inf

    def _fit(self, ideal: NDArray[np.float32], start: Array, level: int) -> PrintPose:
        image = blurred(ideal, BLURS_PX[level])
        by_x, by_y = gradients(image)
        x = start.copy()
        prior = np.where(np.isfinite(PRIOR_SD), PRIOR_SD**-2.0, 0.0)
        information, scale, explained = np.zeros((6, 6)), 1.0, 0.0
        shared = np.zeros((3, 3)), np.zeros(3)
        for _ in range(_ITERATIONS[level]):
            pixels, jacobian, facing = self._projected(x)
            inside = facing & np.all((pixels > 2) & (pixels < self._far), axis=1)
            if inside.sum() < _LEAST_SEEN:
                break
            at = pixels[inside].astype(np.float32)
            grey = _sample(image, at)
            slope = np.column_stack([_sample(by_x, at), _sample(by_y, at)])
            by_image = np.einsum("ni,nij->nj", slope, jacobian[inside])
            light, off, weight, scale = self._without_light(grey, level, inside)
            limit = _TUKEY * _BLURRED * max(self._noise, _LEAST_NOISE)
            explained = float(np.mean(np.clip(1.0 - (off / limit) ** 2, 0.0, None) ** 2))
            rows = weight / scale**2 / _CORRELATED[level]
            A = np.column_stack([by_image, -light])
            normal = (A * rows[:, None]).T @ A
            right = (A * rows[:, None]).T @ off
            # The light drops out.
            inner = normal[9:, 9:] + 1e-9 * np.eye(light.shape[1])
            solved = np.linalg.solve(inner, np.column_stack([normal[9:, :9], right[9:]]))
            outer = normal[:9, :9] - normal[:9, 9:] @ solved[:, :9]
            gradient = right[:9] - normal[:9, 9:] @ solved[:, 9]
            information = outer[:6, :6] + np.diag(prior)
            gradient[:6] -= prior * x
            own = np.linalg.solve(information, np.column_stack([outer[:6, 6:], gradient[:6]]))
            shared = outer[6:, 6:] - outer[6:, :6] @ own[:, :3], gradient[6:] - outer[6:, :6] @ own[:, 3]
            step = np.clip(own[:, 3], -_LARGEST_STEP, _LARGEST_STEP)
            x = x + step
            if abs(step[THETA]) < 2e-6 and np.abs(step[X:]).max() < 1e-6:
                break
        if not np.all(np.isfinite(x)) or np.linalg.cond(information) > 1e20:
            return PrintPose(start, np.diag(_OPEN_SD**2), np.inf, 0.0, (np.zeros((3, 3)), np.zeros(3)))
        covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
        return PrintPose(x, covariance, scale, explained, shared)

    @property
    def _far(self) -> Array:
        return np.array([self._camera.width - 3, self._camera.height - 3])

    def _projected(self, x: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Ideal pixels (m, 2) of the points, derivatives (m, 2, 9), and True for points that face the camera.

        The derivatives are by the frame's unknowns (6), then by the pose at rest (3).
        """
        c, s = np.cos(x[:3]), np.sin(x[:3])
        tip = np.array([[c[0], 0, s[0]], [0, 1, 0], [-s[0], 0, c[0]]])
        roll = np.array([[1, 0, 0], [0, c[1], -s[1]], [0, s[1], c[1]]])
        yaw = np.array([[c[2], -s[2], 0], [s[2], c[2], 0], [0, 0, 1]])
        tipped = self._arms @ tip.T
        rolled = tipped @ roll.T
        turned = rolled @ yaw.T
        shift = x[X:] + np.array([self._radius * x[THETA], 0.0, 0.0])
        points = turned + self._pivot + shift
        in_camera = points @ self._R.T + self._t
        by_point = project_jacobian(self._camera, in_camera) @ self._R
        by = np.empty((len(points), 3, 9))
        by[:, :, THETA] = np.cross([0.0, 1.0, 0.0], tipped) @ (yaw @ roll).T + [self._radius, 0.0, 0.0]
        by[:, :, ROLL] = np.cross([1.0, 0.0, 0.0], rolled) @ yaw.T
        by[:, :, YAW] = np.cross([0.0, 0.0, 1.0], turned)
        by[:, :, 3:6] = np.eye(3)
        # The object turned and shifted at rest, with its edge, and the points on their lines of sight.
        by[:, :, 6:] = _moved(turned) + yaw @ roll @ tip @ (self._by_rest - _moved(self._arms))
        normals = self._template.normals @ (yaw @ roll @ tip).T
        sight = self._camera.T_world_camera[:3, 3] - points
        facing = np.sum(normals * sight, axis=1) > 0.15 * np.linalg.norm(sight, axis=1)
        return project_ideal(self._camera, in_camera), by_point @ by, facing

    def _without_light(
        self, grey: Array, level: int, inside: NDArray[np.bool_]
    ) -> tuple[Array, Array, Array, float]:
        """Terms (n, 4 f) of the light on f faces, residuals (n,) without it, weights (n,), robust scale."""
        template = self._template
        rest = template.grey[level][inside]
        terms = np.column_stack([rest, template.shading[inside]])
        face = template.face[inside]
        light = np.zeros((len(rest), 4 * template.faces))
        light.reshape(len(rest), template.faces, 4)[np.arange(len(rest)), face] = terms
        weight, scale, off = np.ones(len(rest)), 1.0, np.zeros(len(rest))
        for _ in range(2):
            weighted = light * weight[:, None]
            normal = weighted.T @ light + 1e-6 * np.eye(light.shape[1])
            off = light @ np.linalg.solve(normal, weighted.T @ grey) - grey
            scale = max(1.4826 * float(np.median(np.abs(off))), _LEAST_NOISE)
            weight = np.clip(1.0 - (off / (_TUKEY * scale)) ** 2, 0.0, None) ** 2
        return light, off, weight, scale


def _sample(image: NDArray[np.float32], at: NDArray[np.float32]) -> Array:
    """Values (n,) of an image between its pixels, at (n, 2) [px]."""
    return cv2.remap(image, at[:, :1], at[:, 1:], cv2.INTER_LINEAR)[:, 0].astype(np.float64)


def _explained(pose: PrintPose) -> float:
    return pose.explained


def _by_rest_pose(template: PrintTemplate, camera: CameraModel, pivot: Array) -> Array:
    """Derivative (m, 3, 3) of the points at rest by the pose at rest: turn about W's z, shift along x and y.

    A point stays on its line of sight; its depth follows the face. The turn is about the pivot point.
    """
    ray = template.points - camera.T_world_camera[:3, 3]
    moved = _moved(template.points - pivot)
    depth = np.einsum("ni,nij->nj", template.normals, moved) / np.sum(template.normals * ray, axis=1)[:, None]
    return ray[:, :, None] * depth[:, None, :]


def _moved(arms: Array) -> Array:
    """Derivative (m, 3, 3) of points, at arms (m, 3) from the pivot, by a turn about z and shifts in x, y."""
    moved = np.zeros((len(arms), 3, 3))
    moved[:, :, 0] = np.cross([0.0, 0.0, 1.0], arms)
    moved[:, 0, 1] = moved[:, 1, 2] = 1.0
    return moved
