"""Fit of the camera's pose to the corners of the mat's tags, with the paper's curl and glued sheets."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from analyze.errors import CalibrationError
from analyze.tracking.camera_model import project_ideal, project_jacobian

if TYPE_CHECKING:
    from analyze.calibration.mat_view import MatView
    from analyze.types import Array, CameraModel

MODEL_PX = 0.03
"""standard deviation of a corner beside the image's noise [px]: lens, ink, edges that are not straight"""
HEIGHT_SD, HEIGHT_REACH = 1.5e-4, 0.04
"""standard deviation of the paper's height over the table [m], for a sheet that is taped flat, and the
distance over which it keeps its height [m]"""
SHEET_SD, SHEET_TURN_SD = 0.7e-3, math.radians(0.2)
"""standard deviations of a glued sheet's place [m] and turn [rad] on the middle one"""
_STEPS, _TOLERANCE = 12, 1e-9


@dataclass(frozen=True)
class MatSolution:
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


class MatFit:
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

    def solve(self) -> MatSolution:
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
            place = pose_matrix(turned, place[:3, 3] + step[3:6])
            extra = extra + step[6:]
            by_all, residual, raw = self._linearise(place, extra)
            if float(np.max(np.abs(step))) < _TOLERANCE:
                break
        return self._solution(place, by_all, residual, raw)

    def _solution(self, T: Array, J: Array, residual: Array, raw: Array) -> MatSolution:
        """Covariances at the best fit, scaled if the residuals exceed their errors."""
        inverse = np.linalg.inv(J.T @ J)
        many = residual.size - len(self._prior)
        freedom = max(1, many - 6)
        scatter = max(1.0, float(residual @ residual) / freedom)
        # What noise in the corners alone does to the pose: the gain, applied to the noise's own covariance.
        gain: Array = (inverse @ J[:many].T)[:6]
        share = np.einsum("nkij,nkjl,nkml->nkim", self._root, self._view.covariance, self._root)
        blocks = gain.reshape(6, -1, 2)
        noise: Array = np.einsum("ain,inm,bim->ab", blocks, share.reshape(-1, 2, 2), blocks)
        chi = np.sqrt(np.mean(residual[:many].reshape(-1, 8) ** 2, axis=1))
        every: Array = np.asarray(inverse[:6, :6] * scatter, dtype=np.float64)
        return MatSolution(T, every, noise * scatter, chi, raw)

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
                return pose_matrix(R.T, position)
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


def pose_matrix(R: Array, p: Array) -> Array:
    """Pose (4, 4) of a rotation (3, 3) and a place (3,)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T
