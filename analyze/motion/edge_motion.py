"""How the edge itself moved during a strike: slid along the table, or left it.

The camera sees where the point moves that is taken for the edge. Where that point is off the true edge by d, turning alone moves it by
(R(theta) - 1) d: a registration error, no sliding. It is told apart by what it does off the table, and taken out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analyze.motion.tip_angle import PlanarMotion
    from analyze.types import Array

_OFFSET_SD = 5e-4
"""m, of the edge's place as the plan and the marker's registration have it"""
_OFFSET_MOST = 1.5e-3
"""m; what would need more is a lift, unless turning explains all that was seen, along the table too"""
_HELD = 6e-5
"""m, of what turning may leave unexplained there"""
_UNMODELLED = 3e-5
"""m, of a frame's lift: the rounding is no perfect circle, nor the lens model perfect"""
_SHARED = 3.0
"""neighbouring frames share most of that: ten of them count as one"""
_NEIGHBOURS = 5
_OUTLIER = 3.0
_LEFT = 3e-4
"""m, that the edge must have risen at the end of a window to have left the table for good"""


@dataclass(frozen=True)
class EdgeMotion:
    """Of the frames of a window, against its first frames."""

    motion: PlanarMotion
    """with slip and lift of the edge itself"""
    slid: float
    """m, most that it slid, less what noise makes of it"""
    lifted: float
    """m, the same off the table"""
    offset: Array
    """(2,) m, along and off the table at rest, of the true edge from where it was taken to be"""
    offset_covariance: Array
    """(2, 2) m^2"""


def edge_motion(motion: PlanarMotion, window: tuple[int, int]) -> EdgeMotion:
    """Slip and lift of the edge, its misplacement taken out.

    Args:
        motion: as tip_angle gives it.
        window: frames [start, stop) that are looked at; all are corrected.
    """
    angle = motion.angle
    used = slice(*window)
    theta, sd = angle.theta[used], np.maximum(motion.position_sd[used], 1e-7)
    found = _corrected(motion, used, *_lifted_by(theta, motion.lift[used], sd), sd)
    if max(found.slid, found.lifted) < _HELD:
        return found
    # Or is the point farther off than it should be, and the edge did hold?
    misplaced = _misplaced(theta, angle.slip[used], motion.lift[used], sd)
    return found if misplaced is None else _corrected(motion, used, *misplaced, sd)


def moved_by_offset(theta: Array) -> Array:
    """(n, 2, 2): how far (along, off the table) turning moves a point, per metre that it lies (along, off) beside the edge."""
    sin, turned = np.sin(theta), np.cos(theta) - 1.0
    return np.stack([np.stack([turned, sin], axis=-1), np.stack([-sin, turned], axis=-1)], axis=-2)


def left_table(motion: PlanarMotion, window: tuple[int, int]) -> int | None:
    """First frame of a window from which the edge only rises: the body has gone over to a next edge, or flies. None: it does neither.

    A body with a bevel or facets comes down on the next edge before the next face does, and turns about that one from then on.
    """
    first, last = window
    lift = motion.lift[first:last]
    noise = 4.0 * np.maximum(motion.position_sd[first:last], _UNMODELLED)
    if len(lift) < 2 * _NEIGHBOURS or float(np.median(lift[-3:])) < _LEFT:
        return None
    down = np.flatnonzero(lift <= noise)
    if not len(down):
        return None
    start = int(down[-1]) + 1
    rises = bool(np.all(np.diff(lift[start:]) > -noise[start + 1 :]))
    return first + start if rises else None


def _corrected(motion: PlanarMotion, used: slice, offset: Array, covariance: Array, sd: Array) -> EdgeMotion:
    angle = motion.angle
    along, off = (moved_by_offset(angle.theta) @ offset).T
    slip, lift = angle.slip - along, motion.lift - off
    corrected = replace(motion, angle=replace(angle, slip=slip), lift=lift)
    return EdgeMotion(corrected, smooth_range(slip[used], sd), max(0.0, smooth_range(lift[used], sd)), -offset, covariance)


def _lifted_by(theta: Array, lift: Array, sd: Array) -> tuple[Array, Array]:
    """(2,) m that the point is off an edge that slides, and covariance (2, 2): only what that does off the table tells it."""
    A = moved_by_offset(theta)[:, 1]
    scale = _SHARED * np.hypot(sd, _UNMODELLED)
    weight = np.ones_like(lift)
    offset: Array = np.zeros(2)
    normal = np.eye(2) / _OFFSET_SD**2
    for _ in range(8):
        rows = A * (np.sqrt(weight) / scale)[:, None]
        normal = rows.T @ rows + np.eye(2) / _OFFSET_SD**2
        offset = np.asarray(np.linalg.solve(normal, rows.T @ (lift * np.sqrt(weight) / scale)), dtype=np.float64)
        left = np.abs(lift - A @ offset) / scale
        weight = np.minimum(1.0, _OUTLIER * max(1.0, 1.4826 * float(np.median(left))) / np.maximum(left, 1e-9))
    covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    # One that is too far to be true is a lift: then the offset is what it was before.
    return (offset, covariance) if float(np.linalg.norm(offset)) < _OFFSET_MOST else (np.zeros(2), np.eye(2) * _OFFSET_SD**2)


def _misplaced(theta: Array, slip: Array, lift: Array, sd: Array) -> tuple[Array, Array] | None:
    """(2,) m that the point is off an edge that holds (a tag of unknown place, or not printed to scale), and covariance (2, 2).

    None where the edge did not hold.
    """
    moved, still = moved_by_offset(theta), np.zeros(len(theta))
    off_table = np.concatenate([moved[:, 1], still[:, None]], axis=1)
    along = np.concatenate([moved[:, 0], still[:, None] + 1.0], axis=1)
    rows, seen, weight = np.concatenate([off_table, along]), np.concatenate([lift, slip]), 1.0 / np.tile(sd, 2)
    rows = rows * weight[:, None]
    found = np.linalg.lstsq(rows, seen * weight, rcond=None)[0]
    covariance = np.asarray(np.linalg.pinv(rows.T @ rows), dtype=np.float64)[:2, :2]
    left_lift, left_slip = np.split(seen - rows / weight[:, None] @ found, 2)
    held = len(theta) >= 2 * _NEIGHBOURS and max(smooth_range(left_lift, sd), smooth_range(left_slip, sd)) < _HELD
    return (np.asarray(found[:2], dtype=np.float64), covariance) if held else None


def smooth_range(values: Array, sd: Array) -> float:
    """Range of the medians of five neighbours [as values], less four of their own sd: what noise alone hardly reaches."""
    if len(values) < _NEIGHBOURS:
        return 0.0
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(values, _NEIGHBOURS), axis=1)
    # The median of five normal values has 0.536 of their sd.
    noise = 4.0 * math.sqrt(2.0) * 0.536 * float(np.median(sd))
    return max(0.0, float(np.ptp(smooth)) - noise)
