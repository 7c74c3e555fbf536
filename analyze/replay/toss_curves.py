"""Data of a toss that a replay draws, as plain arrays: track of c, angular velocity, residuals, tags."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.flight.first_guess import body_poses
from analyze.flight.flight_model import COM, FlightModel
from analyze.motion.body_motion import BodyMotion
from analyze.tracking.camera_model import distort

if TYPE_CHECKING:
    from analyze.flight.flight_model import ThrownBody
    from analyze.flight.toss import FittedFlight
    from analyze.types import Array, CameraModel, IntArray


@dataclass(frozen=True)
class TossCurves:
    """A free flight as fitted, in its n frames, and m views of tags; a view is one tag in one frame."""

    time_ns: IntArray
    """(n,) log times of the frames [ns]"""
    p_world_com: Array
    """(n, 3) fitted place of c in the world frame W [m]"""
    R_world_object: Array
    """(n, 3, 3) fitted attitude: rotation from the object frame O to W"""
    p_world_object: Array
    """(n, 3) fitted place of O's origin in W [m]"""
    rate: Array
    """(n, 3) fitted angular velocity along the axes of O [rad/s]"""
    seen_ns: IntArray
    """(k,) log times halfway between neighbouring frames [ns]"""
    seen_rate: Array
    """(k, 3) angular velocity along the axes of O [rad/s], by the tag seen best in each frame alone"""
    view_ns: IntArray
    """(m,) log times of the views [ns]"""
    corners_px: Array
    """(m, 4, 2) corners of the tags as found [raw px]"""
    residual_px: Array
    """(m,) rms difference between found and fitted corners [px]"""
    tag: tuple[int | str, ...]
    """(m,) names of the views' tags"""


def toss_curves(flight: FittedFlight, body: ThrownBody, camera: CameraModel) -> TossCurves:
    """Curves of a fitted flight.

    Args:
        flight: flight with its views and fit.
        body: hull, mass and size of the body, as in the fit.
        camera: camera that took the frames.
    """
    views, tags = flight.views, flight.tags
    model = FlightModel(body, camera, tags, [(views, flight.start)])
    x = np.concatenate([flight.shared, flight.start.numbers])
    expected = model(x)[0].reshape(-1, 4, 2)
    (path,) = model.paths(x)
    residual = np.sqrt(np.mean(np.sum((views.corners - expected) ** 2, axis=2), axis=1))
    seen = body_poses(views, tags, camera)[0]
    return TossCurves(
        views.time_ns,
        path.place,
        path.R_world_object,
        path.place - path.R_world_object @ flight.shared[COM],
        path.spin,
        views.time_ns[:-1] + np.diff(views.time_ns) // 2,
        BodyMotion(views.seconds, np.zeros((len(views), 3)), seen).angular_velocity,
        views.time_ns[views.frame],
        distort(camera, views.corners),
        residual,
        tuple(tags.names[i] for i in views.tag),
    )
