"""Central and parallel projections from the world frame W to a picture, fitted into a frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analyze.types import Array


@dataclass(frozen=True)
class View:
    """Projection of points in the world frame W of a strike to a picture."""

    axes: Array
    """(3, 3) rows: right, up and towards the eye, as unit vectors in W."""
    target: Array
    """(3,) point [m] in W at which the eye looks."""
    distance: float | None
    """Distance [m] from the eye to the target; None for a parallel projection."""
    scale: float = 1.0
    """Scale [px/m] at the target."""
    centre: Array | tuple[float, float] = (0.0, 0.0)
    """(2,) pixel of the target, x right and y down."""

    def project(self, points: Array) -> Array:
        """Pixels (n, 2), x right and y down, of `points` (n, 3) [m] in the world frame."""
        seen = (np.atleast_2d(points) - self.target) @ self.axes.T
        near = (
            np.ones(len(seen))
            if self.distance is None
            else self.distance / np.maximum(self.distance - seen[:, 2], 1e-3)
        )
        return self.centre + (self.scale * near)[:, None] * seen[:, :2] * [1.0, -1.0]

    def nearness(self, points: Array) -> Array:
        """Nearness (n,) [m] of `points` (n, 3) [m] in the world frame: greater is nearer to the eye.

        It is measured along the line of sight, from the point `target` at which the eye looks; points on the
        eye's side of it have a positive nearness.
        """
        return (np.atleast_2d(points) - self.target) @ self.axes[2]

    def towards_eye(self, points: Array) -> Array:
        """Vectors (n, 3) [m] from `points` (n, 3) [m] to the eye, both in the world frame.

        For a parallel projection each is the unit vector towards the eye.
        """
        points = np.atleast_2d(points)
        if self.distance is None:
            return np.broadcast_to(self.axes[2], points.shape)
        return self.target + self.distance * self.axes[2] - points

    def fitted(
        self, points: Array, upper_left: tuple[float, float], lower_right: tuple[float, float]
    ) -> View:
        """Copy of the view, scaled and shifted so that points just fit into a frame of the picture.

        The points are centred, and fill the frame in width or height.

        Args:
            points: (n, 3) points [m] in the world frame, not all in one row or column of the picture.
            upper_left: Upper left corner of the frame [px].
            lower_right: Lower right corner of the frame [px].
        """
        bare = replace(self, scale=1.0, centre=(0.0, 0.0)).project(points)
        low, high = bare.min(axis=0), bare.max(axis=0)
        start, end = np.array(upper_left), np.array(lower_right)
        scale = float(np.min((end - start) / (high - low)))
        return replace(self, scale=scale, centre=(start + end) / 2 - scale * (low + high) / 2)


def from_the_front_right(target: Array, distance: float, azimuth: float, elevation: float) -> View:
    """Central projection from an eye on the side -y of a target, in front of it and to its right.

    The scale at the target is 1 px/m; fit it with `View.fitted`.

    Args:
        target: (3,) point [m] in the world frame at which the eye looks.
        distance: Distance [m] of the eye from the target.
        azimuth: Angle [rad] of the eye from -y towards +x.
        elevation: Angle [rad] of the eye above the horizontal.
    """
    eye = np.array(
        [np.sin(azimuth) * np.cos(elevation), -np.cos(azimuth) * np.cos(elevation), np.sin(elevation)]
    )
    right = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    return View(np.stack([right, np.cross(eye, right), eye]), target, distance)


def from_the_camera() -> View:
    """Parallel projection along +y of the world frame, as the camera looks, with 1 px/m.

    In the picture x is to the right and z upwards.
    """
    return View(np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.zeros(3), None)


def from_above() -> View:
    """Parallel projection along -z of the world frame, with 1 px/m.

    In the picture x is to the right and y upwards.
    """
    return View(np.eye(3), np.zeros(3), None)
