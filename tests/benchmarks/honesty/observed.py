"""Poses as the tracker gives them: tipping angle, slip and lift of the planned edge, with its errors.

The tracker follows the point where the stated places of the tags put the planned edge. That point differs
from the true edge by the errors of the tags' places, of the scan and of the stated radius. The lens strains
the image. Drawn per strike: noise of every frame, an error of theta's zero, the phase of the frames.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from analyze.motion.rest_pose import UNMEASURED_TURN_SD
from analyze.motion.tip_angle import PlanarMotion
from analyze.tracking.camera_model import UNSTATED_STRAIN_SD
from analyze.types import MARKER_TURN_SD, RestTurn, TipAngle
from schemas.strike_plan import PlannedStrike
from tests.benchmarks.honesty.disturbances import Disturbance
from tests.benchmarks.honesty.struck import StruckMotion

T0 = 10**18
"""log time of the push [ns]"""
REST = 0.25
"""time filmed before the push [s]"""
LEVER = 0.08
"""distance of a tag from the edge [m]: an angle's noise moves the edge by so much"""
STATED_PLACE_SD = math.hypot(3e-4, math.radians(0.3) * LEVER)
"""standard deviation of the edge's place that the tracker gives where the tags' places are stated [m]"""
ZERO_SD = math.radians(0.005)
"""error of theta's zero by lens and print, which frames share"""

ROLL_SD = math.radians(0.1)
"""error of the camera's stated roll, the same in all strikes"""
ROLL_NOISE = 30
"""noise of the rotation about the horizontal axis across the edge, over theta's: a tag that faces the camera
shows it by its tilt in the image alone"""
REST_TURN_SD = math.radians(0.02)
"""error of a turn at rest by the tag's tilt in the image and the object's heading, of each strike"""


@dataclass(frozen=True)
class View:
    """Errors of a session's camera and tags, drawn once."""

    rate: float
    """frames per second"""
    noise: float
    """noise of theta per frame [rad]"""
    strain: float
    """strain of the image"""
    strain_sd: float
    """standard deviation of the strain as the calibration states it, or the one assumed where it states
    none"""
    roll: float
    """error of the camera's stated roll [rad]"""
    tags: dict[tuple[int, ...], np.ndarray]
    """(6,) error of place [m] and turn [rad] in O of the tag seen along each direction"""


def draw_view(disturbance: Disturbance, rng: np.random.Generator) -> View:
    """Camera and tags of a session."""
    noise = math.radians(0.01 * 8 ** rng.random())
    tags: dict[tuple[int, ...], np.ndarray] = {}
    for axis in np.ndindex(3, 3, 3):
        place, turn = rng.normal(0, disturbance.tag_place, 3), rng.normal(0, disturbance.tag_turn, 3)
        tags[tuple(np.array(axis) - 1)] = np.concatenate([place, turn])
    stated = disturbance.lens if disturbance.lens_stated else UNSTATED_STRAIN_SD
    rate, strain = float(rng.choice([120.0, 240.0])), rng.normal(0, disturbance.lens)
    return View(rate, noise, strain, stated, rng.spawn(1)[0].normal(0, ROLL_SD), tags)


def tag_error(view: View, direction: np.ndarray) -> np.ndarray:
    """Error (6,) of place [m] and turn [rad] in O of the tag seen along a direction (3,) in O."""
    return view.tags[tuple(np.rint(direction / max(np.abs(direction).max(), 0.5)).astype(int))]


def followed_point(
    planned: PlannedStrike,
    motion: StruckMotion,
    view: View,
    disturbance: Disturbance,
    rng: np.random.Generator,
) -> np.ndarray:
    """Material point (3,) in the true O [m] that the tracker takes for the planned edge."""
    pivot, direction = np.array(planned.pivot.point), np.array(planned.pivot.direction)
    if disturbance.unplaced is not None:
        # No place of a tag is known: the edge is where the plan puts it on the table.
        rest = Rotation.from_quat(motion.quaternion[0]).as_matrix()
        edge = rest @ motion.tip.line + motion.position[0]
        at = np.array([edge[0] + rng.normal(0, disturbance.unplaced), edge[1], planned.pivot.radius_m])
        return rest.T @ (at - motion.position[0])
    error = tag_error(view, direction)
    tag = pivot + LEVER * np.array(planned.R_world_object)[2]
    return pivot + error[:3] + np.cross(error[3:], pivot - tag)


def observe(
    planned: PlannedStrike,
    struck: StruckMotion,
    view: View,
    disturbance: Disturbance,
    rng: np.random.Generator,
) -> tuple[PlanarMotion, float]:
    """Motion of the planned edge in every frame, and the turn of the rest pose [rad] that was drawn.

    Args:
        planned: the strike as planned from the description.
        struck: the true poses.
        view: camera and tags of the session.
        disturbance: sizes of the errors.
        rng: generator of this strike's errors.
    """
    point = followed_point(planned, struck, view, disturbance, rng)
    time, turned, path = _sampled(struck, point, view.rate, rng)
    yaw, roll, theta = turned.T
    crumb = rng.normal(0, disturbance.rest)
    moving = theta > max(crumb, 0.0)
    theta = np.where(moving | (crumb < 0) & (time > 0), theta - crumb, 0.0)
    bearing = rng.uniform(0, np.pi)
    theta = theta + 0.5 * view.strain * (np.sin(2 * (theta + bearing)) - np.sin(2 * bearing))
    slip = path[:, 0] * (1 + view.strain) - planned.pivot.radius_m * theta
    lift = path[:, 2] * (1 + view.strain)
    n, rest = len(time), time < 0
    error = rng.normal(0, view.noise, n)
    error -= error[rest].mean()
    zero = rng.normal(0, math.hypot(ZERO_SD, view.noise / math.sqrt(rest.sum())))
    error = np.where(rest, error, error + zero)
    small = rng.normal(0, 1e-5, (2, n))
    slip = slip - LEVER * error * np.cos(theta) + small[0]
    lift = lift + LEVER * error * np.sin(theta) + small[1]
    by_error = view.noise * np.stack([np.ones(n), -LEVER * np.cos(theta), LEVER * np.sin(theta)], axis=-1)
    covariance = by_error[:, :, None] * by_error[:, None, :] + np.diag([0.0, 1e-10, 1e-10])
    angle = TipAngle(
        np.rint(time * 1e9).astype(np.int64) + T0,
        theta + error,
        np.full(n, view.noise),
        np.hypot(yaw, roll) + np.abs(rng.normal(0, 2 * view.noise, n)),
        slip - slip[rest].mean(),
        zero_sd=math.hypot(ZERO_SD, view.noise / math.sqrt(rest.sum())),
        strain_sd=view.strain_sd,
    )
    position_sd, off_axis_sd = np.full(n, math.hypot(LEVER * view.noise, 1e-5)), np.full(n, 2 * view.noise)
    place_sd = STATED_PLACE_SD if disturbance.unplaced is None else None
    rise = lift - lift[rest].mean()
    own = rng.spawn(1)[0]
    turns: tuple[RestTurn, ...] = ()
    if disturbance.unplaced is None:
        turns = (_rest_turn(planned, struck, crumb, angle, view, disturbance, own),)
    roll_sd = np.full(n, ROLL_NOISE * view.noise)
    roll = roll - roll[rest].mean() + own.normal(0, roll_sd)
    motion = PlanarMotion(
        angle, rise, position_sd, off_axis_sd, 0.0, covariance, place_sd, turns, roll, roll_sd
    )
    return motion, crumb


def _rest_turn(
    planned: PlannedStrike,
    motion: StruckMotion,
    crumb: float,
    angle: TipAngle,
    view: View,
    disturbance: Disturbance,
    rng: np.random.Generator,
) -> RestTurn:
    """Turn of the resting body against its planned pose, as the tag that looks at the camera shows it."""
    direction = np.array(planned.pivot.direction)
    own = math.hypot(angle.zero_sd, 0.5 * view.strain_sd, REST_TURN_SD)
    R_rest = Rotation.from_quat(motion.quaternion[0]).as_matrix()
    placed = Rotation.from_matrix(R_rest @ np.array(planned.R_world_object).T).as_rotvec()[1]
    off = tag_error(view, direction)[3:] @ direction + view.roll + rng.normal(0, own)
    return RestTurn(
        float(crumb + placed + off),
        own,
        str(np.rint(direction).astype(int).tolist()),
        UNMEASURED_TURN_SD if disturbance.tag_turn >= MARKER_TURN_SD else disturbance.tag_turn,
        str(planned.heading_rad),
    )


def _sampled(
    motion: StruckMotion, point: np.ndarray, rate: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frame times (n,) [s], yaw, roll and theta (n, 3) [rad], and displacement (n, 3) [m] of a point."""
    frames = np.arange(-round(REST * rate), math.floor(motion.time[-1] * rate)) / rate + rng.random() / rate
    frames = frames[frames < motion.time[-1]]
    inside = np.clip(frames, 0.0, None)
    rotation = Slerp(motion.time, Rotation.from_quat(motion.quaternion))(inside)
    position = np.stack([np.interp(inside, motion.time, axis) for axis in motion.position.T], axis=1)
    turned = rotation * Rotation.from_quat(motion.quaternion[0]).inv()
    path = rotation.apply(point) + position
    first = Rotation.from_quat(motion.quaternion[0]).apply(point) + motion.position[0]
    return frames, turned.as_euler("ZXY"), path - first
