"""Simulated tag that is held, dropped and lands, seen by a camera; independent of the fit.

Models gravity, drag proportional to the square of the speed, steady turning, an arm from the centre of mass
to the tag, rolling shutter and the noise of corners. Does not model blur, flutter, or the hand's touch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from analyze.tracking.pose import choose_by_motion, marker_corners, solve_poses
from analyze.types import CameraModel, MarkerTrack

GRAVITY = 9.81


@dataclass(frozen=True)
class Drop:
    """A tag that is held, dropped and lands, in view of a camera; times are true seconds."""

    fps: float = 240.0
    stated_fps: float = 240.0
    fall: float = 0.7
    """height of the fall [m]"""
    size: float = 0.04
    distance: float = 1.3
    drag: float = 0.0
    """deceleration by air over the square of the speed, beta [1/m]"""
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """angular velocity in C [rad/s]"""
    arm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """vector from the centre of mass to the tag, in M [m]"""
    down: tuple[float, float, float] = (0.03, 1.0, 0.05)
    """direction of gravity in C, of any length"""
    line_time: float = 0.0
    """delay between the readout of neighbouring rows [s]"""
    corner_sd: float = 0.05
    bounces: bool = True
    held_s: float = 0.4
    seed: int = 0


CAMERA = CameraModel(
    1080, 1920, np.array([[1500.0, 0, 539.5], [0, 1500, 959.5], [0, 0, 1]]), np.zeros(5), np.eye(4)
)


def pose(drop: Drop, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation R (n, 3, 3) and position (n, 3) [m] of the tag in C at true times [s], released at 0."""
    down = np.array(drop.down) / np.linalg.norm(drop.down)
    start = np.array([0.02, -drop.fall / 2, drop.distance])
    till = float(max(time.max(), 0.0)) + 0.01
    flight = solve_ivp(
        lambda _, s: [s[1], GRAVITY - drop.drag * s[1] * abs(s[1])],
        (0, till),
        [0, 0],
        rtol=1e-10,
        atol=1e-12,
        dense_output=True,
    )
    landed = (
        brentq(lambda t: flight.sol(t)[0] - drop.fall, 0, till) if flight.sol(till)[0] > drop.fall else np.inf
    )
    s = np.zeros_like(time)
    turned = np.clip(time, 0, None)
    falling = (time > 0) & (time <= landed)
    if falling.any():
        s[falling] = flight.sol(time[falling])[0]
    after = time > landed
    if after.any():
        u = time[after] - landed
        up = 0.35 * flight.sol(landed)[1]
        air = 2 * up / GRAVITY
        s[after] = (
            drop.fall - np.where(u < air, up * u - GRAVITY * u**2 / 2, 0.0) if drop.bounces else drop.fall
        )
        turned[after] = landed
    R = (
        Rotation.from_rotvec(turned[:, None] * np.array(drop.spin))
        * Rotation.from_euler("xyz", [np.pi + 0.25, 0.2, 0.1])
    ).as_matrix()
    com = start + s[:, None] * down
    return R, com + R @ np.array(drop.arm)


def corners_px(drop: Drop, time: np.ndarray) -> np.ndarray:
    """Corners (n, 4, 2) [px] without noise, each row read later by the line time."""
    points, K = marker_corners(drop.size), CAMERA.K
    seen = np.zeros((len(time), 4, 2))
    for _ in range(4 if drop.line_time else 1):
        late = (
            time + drop.line_time * (seen.mean(axis=1)[:, 1] - CAMERA.height / 2) if drop.line_time else time
        )
        R, p = pose(drop, late)
        image = (points @ R.transpose(0, 2, 1) + p[:, None]) @ K.T
        seen = image[..., :2] / image[..., 2:]
    return seen


def track(drop: Drop, missing: tuple[int, ...] = ()) -> MarkerTrack:
    """Track of the tag, with the times that the file states."""
    duration = drop.held_s + np.sqrt(2 * drop.fall / GRAVITY) + 0.6
    number = np.setdiff1d(np.arange(int(duration * drop.fps)), missing)
    seen = corners_px(drop, number / drop.fps - drop.held_s + 0.3 / drop.fps)
    return followed(seen, number / drop.stated_fps, drop)


def moved(p: np.ndarray, drop: Drop) -> MarkerTrack:
    """Track of a tag that a hand carries to positions p (n, 3) [m]."""
    R = Rotation.from_euler("xyz", [np.pi + 0.25, 0.2, 0.1]).as_matrix()
    image = (marker_corners(drop.size) @ R.T + p[:, None]) @ CAMERA.K.T
    return followed(image[..., :2] / image[..., 2:], np.arange(len(p)) / drop.stated_fps, drop)


def followed(seen: np.ndarray, stated_s: np.ndarray, drop: Drop) -> MarkerTrack:
    """Track of the tag from corners (n, 4, 2) [px] without noise, to which noise is added."""
    seen = seen + np.random.default_rng(drop.seed).normal(0, drop.corner_sd, seen.shape)
    pairs = [pair for pair in solve_poses(seen, drop.size, CAMERA.K) if pair is not None]
    assert len(pairs) == len(seen)
    sd = np.full(len(seen), drop.corner_sd)
    chosen = choose_by_motion(pairs, stated_s, sd)
    return MarkerTrack(
        0,
        np.round(1e9 * stated_s).astype(np.int64),
        seen,
        sd,
        np.array([pair.R_camera_marker[c] for pair, c in zip(pairs, chosen, strict=True)]),
        np.array([pair.p_camera_marker[c] for pair, c in zip(pairs, chosen, strict=True)]),
        len(seen),
    )
