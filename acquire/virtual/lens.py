"""Projection from world to pixels: pinhole camera with OpenCV's distortion model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.station import Station


class Lens:
    """Projection of points in W, the world frame, to pixels of the virtual camera.

    Args:
        station: the camera's matrix, distortion and pose.
    """

    def __init__(self, station: Station) -> None:
        self.R_camera_world = station.T_world_camera[:3, :3].T.copy()
        self.p_world_camera = station.T_world_camera[:3, 3].copy()
        self._K = station.K
        self._k1, self._k2, self._p1, self._p2, self._k3 = (float(d) for d in station.distortion)

    def pixels(self, points_world: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels (..., 2) of points (..., 3) [m, in W, the world frame] in front of the camera.

        Integer coordinates are pixel centres. With x, y the point's coordinates over its depth in the
        camera's frame and r^2 = x^2 + y^2, distortion gives
        x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2), and y' by exchanging x with y and
        p1 with p2 (OpenCV calib3d, after D. Brown, 1966). k1, k2, p1, p2, k3 are the camera's distortion.
        """
        camera = (points_world - self.p_world_camera) @ self.R_camera_world.T
        x, y = camera[..., 0] / camera[..., 2], camera[..., 1] / camera[..., 2]
        r2 = x * x + y * y
        radial = 1.0 + r2 * (self._k1 + r2 * (self._k2 + r2 * self._k3))
        xy = 2.0 * x * y
        u = x * radial + self._p1 * xy + self._p2 * (r2 + 2.0 * x * x)
        v = y * radial + self._p1 * (r2 + 2.0 * y * y) + self._p2 * xy
        K = self._K
        return np.stack([K[0, 0] * u + K[0, 2], K[1, 1] * v + K[1, 2]], axis=-1)
