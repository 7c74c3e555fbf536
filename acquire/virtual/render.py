"""Renderer of the virtual camera's images: scene, lens, motion blur, sensor.

Polygons are filled by exact area coverage (the fraction of each pixel that lies inside), never by warping an
image, so that renderer and tracker share no operation. Integer pixel coordinates are pixel centres, as in
OpenCV. Not modelled: defocus by depth, reflections, rolling shutter.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from acquire.virtual.backdrop import FAR_EDGE_M, backdrop, table_cover
from acquire.virtual.coverage import Box
from acquire.virtual.layers import Layer, masked, paint, paint_shadow
from acquire.virtual.lens import Lens
from acquire.virtual.render_arm import ArmPainter
from acquire.virtual.render_object import ObjectPainter
from acquire.virtual.sensor import NoiseBank, brightness, noise_sd, vignette
from acquire.virtual.station import ARM_LENGTH_M, HEIGHT_PX, WIDTH_PX

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.objects import VirtualObject
    from acquire.virtual.station import Station

PSF_SIGMA_PX = 0.6
"""standard deviation of the lens's blur [px]"""
_PSF_REACH = 3
"""distance over which the blur acts [px]"""
_SHADOW = 0.38
"""fraction of the light that the object's shadow takes away"""
_AT_REST = 1e-7
"""change of a pose below which the image stays the same [m, rad]"""
_STILL_PX, _STEP_PX, MAX_SUBEXPOSURES = 0.15, 0.8, 8
"""motion in the image [px] below which one pose suffices; largest motion between poses [px]; most poses"""


class Renderer:
    """Renderer of one object and the striker's arm in front of the virtual camera.

    It redraws only what changed since the last frame. Not thread-safe; OpenCV's threads should be off in its
    process.

    Args:
        virtual_object: the object with its tags.
        station: camera calibration and pose.
        seed: seed of background and noise.
        width: image width [px].
        height: image height [px].
    """

    def __init__(
        self,
        virtual_object: VirtualObject,
        station: Station,
        seed: int,
        width: int = WIDTH_PX,
        height: int = HEIGHT_PX,
    ) -> None:
        self._width, self._height = width, height
        self._lens = Lens(station)
        self._object = ObjectPainter(virtual_object, self._lens, width, height)
        self._arm = ArmPainter(self._lens, width, height)
        rng = np.random.default_rng((seed, 0xF0705))
        self._backdrop = backdrop(station, width, height, rng)
        self._blurred_backdrop = _blur(self._backdrop)
        cover = table_cover(station, width, height)
        self._table = Layer(Box(0, 0, width, height), cover, cover)
        self._vignette = vignette(width, height)
        self._noise = NoiseBank(rng, width, height)
        low, high = virtual_object.mesh_vertices.min(axis=0), virtual_object.mesh_vertices.max(axis=0)
        self._corners = np.array(list(product(*zip(low, high, strict=True))))
        self._scene = self._backdrop.copy()
        self._drawn: list[Box] = []
        self._settings = (np.nan, np.nan)
        self._pose = np.full((1, 11), np.nan)
        self._object_pose = np.full((1, 7), np.nan)
        self._object_layers: tuple[Layer | None, Layer | None] = (None, None)
        self._arm_pose = np.full((1, 4), np.nan)
        self._arm_layer: Layer | None = None
        self._empty_clean = self._empty_sd = self._clean = self._sd = np.zeros((height, width), np.float32)

    def render(
        self,
        p_world_object: NDArray[np.float64],
        q_wxyz: NDArray[np.float64],
        arm_angle: NDArray[np.float64],
        arm_axis_world: NDArray[np.float64],
        exposure_us: float,
        gain_db: float,
    ) -> NDArray[np.uint8]:
        """Frame (height, width), uint8: the mean of k poses spread uniformly over the exposure.

        The sensor's noise differs in every frame. k = 1 suffices at rest.

        Args:
            p_world_object: (k, 3) positions of the object's origin in W (world frame, z up) [m].
            q_wxyz: (k, 4) unit quaternions (w, x, y, z) from O, the object's frame, to W.
            arm_angle: (k,) angles of the arm [rad], 0 when it hangs, positive towards +x.
            arm_axis_world: (k, 3) points on the axis about which the arm turns, in W [m].
            exposure_us: exposure of the whole frame [us].
            gain_db: gain of the sensor [dB].
        """
        pose = np.column_stack([p_world_object, q_wxyz, arm_angle, arm_axis_world]).astype(np.float64)
        pose = pose[:1] if np.ptp(pose, axis=0).max() <= _AT_REST else pose
        same_settings = (exposure_us, gain_db) == self._settings
        if not same_settings:
            self._apply_settings(exposure_us, gain_db)
        if not same_settings or not _same_pose(pose, self._pose):
            self._draw(pose)
            self._pose = pose
        return self._noise.expose(self._clean, self._sd)

    def subexposures_needed(
        self,
        p_world_object: NDArray[np.float64],
        q_wxyz: NDArray[np.float64],
        arm_angle: NDArray[np.float64],
        arm_axis_world: NDArray[np.float64],
    ) -> int:
        """Number of poses, 1 to 8, that render the motion blur of an exposure.

        It is 1 if nothing moves by 0.15 px or more; else at least 2, so many that neighbouring poses are at
        most 0.8 px apart, but no more than 8. The motion is that of the arm's tip and of the corners of the
        object's bounding box, from the start of the exposure to its end.

        Args:
            p_world_object: (2, 3) positions of the object's origin in W (world frame) at start and end [m].
            q_wxyz: (2, 4) unit quaternions (w, x, y, z) from O, the object's frame, to W.
            arm_angle: (2,) angles of the arm [rad].
            arm_axis_world: (2, 3) points on the arm's hinge in W [m].
        """
        R = _rotations(q_wxyz)
        corners = self._corners @ np.swapaxes(R, 1, 2) + p_world_object[:, None, :]
        hanging = np.stack([np.sin(arm_angle), np.zeros_like(arm_angle), -np.cos(arm_angle)], axis=1)
        points = np.concatenate([corners, (arm_axis_world + ARM_LENGTH_M * hanging)[:, None, :]], axis=1)
        pixels = self._lens.pixels(points)
        travel = float(np.linalg.norm(pixels[-1] - pixels[0], axis=1).max())
        return 1 if travel < _STILL_PX else int(np.clip(np.ceil(travel / _STEP_PX), 2, MAX_SUBEXPOSURES))

    def _apply_settings(self, exposure_us: float, gain_db: float) -> None:
        self._settings = (exposure_us, gain_db)
        self._empty_clean = (
            self._blurred_backdrop * self._vignette * np.float32(brightness(exposure_us, gain_db))
        )
        self._empty_sd = noise_sd(self._empty_clean, gain_db)
        self._clean, self._sd = self._empty_clean.copy(), self._empty_sd.copy()

    def _draw(self, pose: NDArray[np.float64]) -> None:
        for box in self._drawn:
            area = box.slices
            self._scene[area] = self._backdrop[area]
            self._clean[area], self._sd[area] = self._empty_clean[area], self._empty_sd[area]
        arm, (shadow, item) = self._arm_at(pose[:, 7:]), self._object_at(pose[:, :7])
        if shadow is not None:
            paint_shadow(self._scene, shadow, _SHADOW)
        behind = pose[len(pose) // 2, 1] > FAR_EDGE_M  # a tossed object, behind the arm
        for drawn in (item, arm) if behind else (arm, item):
            if drawn is not None:
                paint(self._scene, drawn)
        layers = [found for found in (shadow, arm, item) if found is not None]
        self._drawn = [found.box.grown(_PSF_REACH, self._width, self._height) for found in layers]
        for box in _without_contained(self._drawn):
            self._expose_region(box)

    def _object_at(self, pose: NDArray[np.float64]) -> tuple[Layer | None, Layer | None]:
        """Layers of the object's shadow, and of the object itself with its tags; None if out of view."""
        pose = pose[:1] if np.ptp(pose, axis=0).max() <= _AT_REST else pose
        if not _same_pose(pose, self._object_pose):
            p, R = pose[:, :3], _rotations(pose[:, 3:])
            middle = len(pose) // 2
            drawn = self._object.layer(p, R)
            if drawn is not None and p[middle, 1] > FAR_EDGE_M:
                drawn = masked(drawn, [self._table])  # tossed behind the table, which hides what is lower
            self._object_layers = self._object.shadow(p[middle], R[middle]), drawn
            self._object_pose = pose
        return self._object_layers

    def _arm_at(self, pose: NDArray[np.float64]) -> Layer | None:
        pose = pose[:1] if np.ptp(pose, axis=0).max() <= _AT_REST else pose
        if not _same_pose(pose, self._arm_pose):
            self._arm_layer = self._arm.layer(pose[:, 0], pose[:, 1:4])
            self._arm_pose = pose
        return self._arm_layer

    def _expose_region(self, box: Box) -> None:
        """Redraw the noise-free grey levels and the noise's standard deviation within a box of the image.

        They are computed from the scene by blur, vignetting, exposure and gain, and stored in the renderer.
        """
        around = box.grown(_PSF_REACH, self._width, self._height)
        exposure_us, gain_db = self._settings
        light = _blur(self._scene[around.slices])[box.within(around)]
        scale = brightness(exposure_us, gain_db)
        clean = np.asarray(cv2.multiply(light, self._vignette[box.slices], scale=scale), np.float32)
        self._clean[box.slices] = clean
        self._sd[box.slices] = noise_sd(clean, gain_db)


def _blur(image: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(
        cv2.GaussianBlur(image, (2 * _PSF_REACH - 1, 2 * _PSF_REACH - 1), PSF_SIGMA_PX), np.float32
    )


def _same_pose(pose: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    return pose.shape == other.shape and bool(np.abs(pose - other).max() <= _AT_REST)


def _rotations(q_wxyz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrices (k, 3, 3) of quaternions (k, 4) (w, x, y, z), which need not be normalised."""
    return Rotation.from_quat(q_wxyz[:, [1, 2, 3, 0]]).as_matrix()


def _without_contained(boxes: list[Box]) -> list[Box]:
    """Boxes of pixels, from large to small, without those that lie inside another one.

    Of equal boxes one is kept.
    """
    kept: list[Box] = []
    for box in sorted(boxes, key=lambda b: -(b.right - b.left) * (b.bottom - b.top)):
        inside = (
            b.left <= box.left and b.top <= box.top and b.right >= box.right and b.bottom >= box.bottom
            for b in kept
        )
        if not any(inside):
            kept.append(box)
    return kept
