"""Planned place of the object in the image, the object's offset from it, and motion in and around it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from analyze.tracking.camera_model import project, world_to_camera
from analyze.tracking.pose import marker_corners

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from analyze.motion.scene import Scene
    from analyze.types import Array, CameraModel, Marker
    from schemas.strike_plan import PlannedStrike

MAX_OUTLINE_POINTS = 60
"""largest number of corners of the outline"""
CHANGED_GREY = 14.0
"""change of a pixel from one image to the next [grey levels] that noise does not cause"""
AROUND_PX = 60.0
"""width of the border around the outline in which motion counts [px]: hands that hold the object"""
MAX_OFFSET_M, MAX_YAW_RAD = 0.3, math.radians(60.0)
"""offset and turn from the plan beyond which the object stands elsewhere: they are not reported"""
MAX_RESIDUAL_PX = 6.0
"""root mean square distance of the corners [px] above which the object lies on another face"""
AXIS_SHARE = 0.4
"""length of the drawn axes over the length of the object's longest side"""
_STEPS = 8
_TURN, _SHIFT = 1e-4, 1e-5
"""steps of the numerical derivatives [rad, m]"""


class WantedPlace:
    """Planned place of the object for one strike.

    Args:
        planned: the strike.
        camera: camera with its pose in the strike's world frame W.
        markers: the object's markers by name.
        hull: (n, 3) vertices of the object's convex hull in O [m]; None if it is not known.
    """

    def __init__(
        self,
        planned: PlannedStrike,
        camera: CameraModel,
        markers: Mapping[int | str, Marker],
        hull: Array | None,
    ) -> None:
        self._camera = camera
        self._R_camera_world, self._p_camera_world = world_to_camera(camera)
        self._R, self._p = np.array(planned.R_world_object), np.array(planned.p_world_object)
        self._corners = {
            name: marker_corners(marker.size) @ marker.T_object_marker[:3, :3].T
            + marker.T_object_marker[:3, 3]
            for name, marker in markers.items()
            if marker.T_object_marker is not None
        }
        self._outline = None if hull is None else self._projected_outline(hull)
        self._axes = None if hull is None else _axes(hull)
        self._region: tuple[slice, slice] | None = None
        if self._outline is not None:
            low, high = self._outline.min(axis=0) - AROUND_PX, self._outline.max(axis=0) + AROUND_PX
            # The scenes' coarse images hold every eighth pixel.
            (left, top), (right, bottom) = np.maximum(low // 8, 0).astype(int), (high // 8).astype(int) + 1
            self._region = (slice(int(top), max(int(bottom), 0)), slice(int(left), max(int(right), 0)))

    def compare(self, scenes: Sequence[Scene]) -> dict[str, Any]:
        """Entries of a WatchEvent: planned outline, offset [m], turn [rad], axes, fraction of changed pixels.

        Args:
            scenes: markers and coarse grey levels of successive images, in order of time.
        """
        offset = self._offset(scenes[-1])
        return {
            "outline_px": None if self._outline is None else np.round(self._outline, 1).tolist(),
            "offset_m": None if offset is None else [round(float(each), 5) for each in offset[:2]],
            "yaw_error_rad": None if offset is None else round(float(offset[2]), 5),
            "axes_px": self._projected_axes(np.zeros(3) if offset is None else offset),
            "moving_fraction": self._moving(scenes),
        }

    def _projected_outline(self, hull: Array) -> Array | None:
        """Corners (m, 2) [px] of the hull's outline in the image; None if a part lies behind the camera."""
        inside = self._in_camera(hull, np.zeros(3))
        if np.any(inside[:, 2] < 0.01):
            return None
        outline = cv2.convexHull(project(self._camera, inside).astype(np.float32))[:, 0, :]
        return outline[:: max(1, -(-len(outline) // MAX_OUTLINE_POINTS))].astype(float)

    def _projected_axes(self, offset: Array) -> list[list[float]] | None:
        """Origin and ends of the object's axes in the image [px]; None if one lies behind the camera."""
        if self._axes is None:
            return None
        inside = self._in_camera(self._axes, offset)
        if np.any(inside[:, 2] < 0.01):
            return None
        return np.round(project(self._camera, inside), 1).tolist()

    def _in_camera(self, points: Array, offset: Array) -> Array:
        """Points (n, 3) of O in the camera frame, with the object off its planned pose by (x, y, yaw)."""
        turn = np.array(
            [
                [math.cos(offset[2]), -math.sin(offset[2]), 0.0],
                [math.sin(offset[2]), math.cos(offset[2]), 0.0],
                [0.0, 0.0, 1.0],
            ]
        )
        world = (points @ self._R.T + self._p) @ turn.T + np.array([offset[0], offset[1], 0.0])
        return world @ self._R_camera_world.T + self._p_camera_world

    def _offset(self, scene: Scene) -> Array | None:
        """Offset (3,) of the object on the table from its planned place: x, y [m] and yaw [rad]; or None.

        The object is taken to stand on the planned face, so that three numbers describe its place; they are
        fitted to all corners of its markers.
        """
        seen = [name for name in scene.corners if name in self._corners]
        if not seen or scene.duplicate_ids:
            return None
        points = np.concatenate([self._corners[name] for name in seen])
        measured = np.concatenate([scene.corners[name] for name in seen])
        offset = np.zeros(3)
        residual = self._residual(points, measured, offset)
        for _ in range(_STEPS):
            jacobian = np.stack(
                [
                    (self._residual(points, measured, offset + step) - residual) / step.sum()
                    for step in np.diag([_SHIFT, _SHIFT, _TURN])
                ],
                axis=-1,
            )
            offset = offset - np.linalg.lstsq(jacobian, residual, rcond=None)[0]
            if np.hypot(offset[0], offset[1]) > MAX_OFFSET_M or abs(offset[2]) > MAX_YAW_RAD:
                return None
            residual = self._residual(points, measured, offset)
        rms_px = math.sqrt(2 * float(np.mean(residual**2)))
        return offset if np.isfinite(rms_px) and rms_px < MAX_RESIDUAL_PX else None

    def _residual(self, points: Array, measured: Array, offset: Array) -> Array:
        """Predicted less measured corners, flat (2 n,) [px]."""
        return (project(self._camera, self._in_camera(points, offset)) - measured).ravel()

    def _moving(self, scenes: Sequence[Scene]) -> float | None:
        """Fraction of the pixels in and around the outline that changed since the image before; or None.

        Brightness that changes as a whole, as under lamps, is no motion.
        """
        if self._region is None or len(scenes) < 2:
            return None
        now, before = scenes[-1].coarse[self._region], scenes[-2].coarse[self._region]
        if not now.size:
            return None
        gain = float(np.mean(now)) / max(float(np.mean(before)), 1.0)
        return round(float(np.mean(np.abs(now - gain * before) > CHANGED_GREY)), 4)


def _axes(hull: Array) -> Array:
    """Origin (0, 0, 0) of O and the ends of its drawn axes x, y and z: (4, 3) [m] in O."""
    length = AXIS_SHARE * float(np.max(np.ptp(hull, axis=0)))
    return np.vstack([np.zeros(3), length * np.eye(3)])
