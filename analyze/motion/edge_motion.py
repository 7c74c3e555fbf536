"""Motion of the pivot edge during a strike: sliding along the table, or lifting off it.

The camera measures the motion of the point that is assumed to be the edge. If that point is off the true edge
by d, rotation alone moves it by (R(theta) - 1) d, with R(theta) the rotation by the tipping angle theta: a
registration error, not sliding. The vertical part of this motion determines d, whose effect is then removed.
An edge whose radius is larger than assumed by e rolls by e theta farther: no sliding either.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.least_squares.robust import huber_weights, median_scale
from analyze.motion.edge_offset import displacement_per_error, displacement_per_offset, fit_creeping

if TYPE_CHECKING:
    from analyze.motion.tip_angle import PlanarMotion
    from analyze.types import Array

_PLAN_SD, _HAND_SD = 5e-4, 2e-2
"""standard deviations [m] of the edge's assumed position by the plan, and where no marker's place is known

Without a marker's place the edge is assumed where the hand was to put it, in the recorded frame of the table.
"""
_MAX_OFFSET_SIGMAS = 3.0
"""largest offset, in its standard deviations before the measurement; a larger one is a lift, unless rotation
explains all observed motion, also along the table"""
_RADIUS_SD, _HELD_RADIUS_SD = 1e-4, 5e-4
"""standard deviation [m] of the edge's assumed radius where it slides, so that its motion does not show the
radius; and where it is held, so that its motion does"""
_MAX_RADIUS_ERROR = 2e-3
"""largest error of the assumed radius [m]; a body in flight drifts as if it rolled on a larger one"""
_MAX_UNEXPLAINED = 6e-5
"""largest slip or lift [m] that a held edge may leave unexplained by rotation"""
_LIFT_MODEL_SD = 3e-5
"""model error of a frame's lift [m]: neither the rounding's circle nor the lens model is perfect"""
_CORRELATION_FACTOR = 3.0
"""factor on the sd for errors shared by neighbouring frames: ten of them count as one"""
_OUTLIER_SIGMAS = 3.0
"""threshold of Huber's weights"""
_NEIGHBOURS = 5
"""width of the running median [frames]"""
_MAX_CREEP = 3e-4
"""largest lift [m] of an edge that hops or sinks but stays on the table"""
_MIN_RISE = 3e-4
"""least lift [m], at the end of a window, of an edge that has left the table for good"""


@dataclass(frozen=True)
class EdgeMotion:
    """Motion of a strike with slip and lift of the true pivot edge, and their ranges [m].

    Slip is sliding along the table, lift the height off it. A range is the largest less the least of the
    smoothed values in a stretch of frames, less what noise explains. The true edge is displaced from the
    assumed one by `offset`.
    """

    motion: PlanarMotion
    """the motion, with slip and lift of the true edge"""
    slide_range: float
    """range of the sliding along the table, less that of noise [m]"""
    lift_range: float
    """range of the height over the table, less that of noise [m]"""
    offset: Array
    """(3,) offset of the true edge from the assumed one at rest, along and off the table, and its radius
    beyond the assumed one [m]"""
    offset_covariance: Array
    """(3, 3) covariance [m^2] of the reverse offset, that of the assumed edge from the true one, and of the
    radius of `offset`"""
    by_radius: Array
    """(n, 2) errors of slip and lift in every frame, per metre by which the edge's radius exceeds the planned
    one"""


def edge_motion(motion: PlanarMotion, window: tuple[int, int]) -> EdgeMotion:
    """Slip and lift of the true pivot edge, corrected for the error of its assumed position.

    Args:
        motion: tipping angle, slip (along the table) and lift (off it) of the assumed edge, from `tip_angle`.
        window: frames [start, stop) from which the error and the ranges are determined; all frames are
            corrected.

    Returns:
        The corrected motion; the ranges of its slip and lift in the window [m]; the offset (3,) of the true
        edge from the assumed one at rest, along and off the table, and its radius beyond the assumed one [m],
        with a covariance (3, 3) [m^2]; and the errors of slip and lift per metre of radius.
    """
    angle = motion.angle
    used = slice(*window)
    theta, sd = angle.theta[used], np.maximum(motion.position_sd[used], 1e-7)
    offset, covariance = _offset_of_sliding_edge(theta, motion.lift[used], sd, _offset_sd(motion))
    found = _corrected(motion, used, offset, covariance, sd)
    if max(found.slide_range, found.lift_range) < _MAX_UNEXPLAINED:
        return found
    # The edge may have held although the point is farther off it than its prior allows.
    misplaced = _offset_of_held_edge(theta, angle.slip[used], motion.lift[used], sd)
    if misplaced is None:
        return found
    held = _corrected(motion, used, *misplaced, sd)
    # The radius was fitted as well.
    return replace(held, by_radius=np.zeros_like(held.by_radius))


def lift_off_frame(motion: PlanarMotion, window: tuple[int, int]) -> int | None:
    """First frame of a window from which the edge only rises off the table; None if there is none.

    From there to the window's end the body flies, or turns about its next edge, that of a bevel or facet.
    None if the window has fewer than ten frames, if the edge is off the table in all of them, or if its
    height at the end is below 0.3 mm.

    Args:
        motion: motion of the strike with the lift of its edge.
        window: frames [start, stop).
    """
    first, last = window
    used = slice(first, last)
    theta, sd = motion.angle.theta[used], motion.position_sd[used]
    lift = _lift_above_most(theta, motion.lift[used], sd, _offset_sd(motion))
    noise = 4.0 * np.maximum(motion.position_sd[first:last], _LIFT_MODEL_SD)
    if len(lift) < 2 * _NEIGHBOURS or float(np.median(lift[-3:])) < _MIN_RISE:
        return None
    down = np.flatnonzero(lift <= noise)
    if not len(down):
        return None
    start = int(down[-1]) + 1
    rises = bool(np.all(np.diff(lift[start:]) > -noise[start + 1 :]))
    return first + start if rises else None


def _offset_sd(motion: PlanarMotion) -> float:
    """Standard deviation [m] of the edge's assumed position before its motion is measured.

    Args:
        motion: motion of the assumed edge; its `place_sd` is the part of this error that comes from the
            markers' places on the object, None if none of these is known.
    """
    return _HAND_SD if motion.place_sd is None else max(_PLAN_SD, motion.place_sd)


def _lift_above_most(theta: Array, lift: Array, sd: Array, offset_sd: float) -> Array:
    """Lift (n,) [m] of the pivot edge in n frames, less what an error of its assumed place explains.

    If the assumed edge lies beside the true one, rotation alone lifts or lowers it. This offset, along and
    off the table, is fitted with a prior of 0 and robust weights, as if the true edge stayed on the table:
    frames in which it was off the table are outliers. `lift` is returned unchanged if the offset comes out as
    three times `offset_sd` or more.

    Args:
        theta: (n,) tipping angle [rad].
        lift: (n,) height of the assumed edge over its position at rest [m].
        sd: (n,) standard deviation of the lift [m].
        offset_sd: standard deviation of the offset before the measurement [m].
    """
    rows = displacement_per_offset(theta)[:, 1]
    scale = _CORRELATION_FACTOR * np.hypot(sd, _LIFT_MODEL_SD)
    weight, offset = np.ones_like(lift), np.zeros(2)
    for _ in range(8):
        weighted = rows * (weight / scale**2)[:, None]
        offset = np.linalg.solve(weighted.T @ rows + np.eye(2) / offset_sd**2, weighted.T @ lift)
        left = np.abs(lift - rows @ offset) / scale
        weight = huber_weights(left, _OUTLIER_SIGMAS, max(1.0, median_scale(left)))
    # An implausibly large offset is a lift.
    return lift - rows @ offset if float(np.linalg.norm(offset)) < _MAX_OFFSET_SIGMAS * offset_sd else lift


def _corrected(motion: PlanarMotion, used: slice, offset: Array, covariance: Array, sd: Array) -> EdgeMotion:
    """Motion of the true pivot edge, from that of the assumed edge, which lies beside it.

    While the object tips, the assumed edge turns about the true one, which rolls on its own radius. These
    displacements are subtracted from slip (along the table) and lift (off it).

    Args:
        motion: the motion with slip and lift of the assumed edge.
        used: slice of the frames over which the ranges of slip and lift are taken; all frames are corrected.
        offset: (3,) offset at rest of the assumed edge from the true one, along and off the table, and radius
            of the true edge beyond the assumed one [m].
        covariance: (3, 3) its covariance [m^2].
        sd: standard deviation of slip and lift in each of the frames `used` [m].

    Returns:
        The corrected motion, with the ranges of its slip and lift [m]. Its `offset` along and off the table
        is that of the true edge from the assumed one, the negative of the argument; its `offset_covariance`
        is that of the argument.
    """
    angle = motion.angle
    along, off = (displacement_per_error(angle.theta) @ offset).T
    slip, lift = angle.slip - along, motion.lift - off
    corrected = replace(motion, angle=replace(angle, slip=slip), lift=lift)
    return EdgeMotion(
        corrected,
        smooth_range(slip[used], sd),
        max(0.0, smooth_range(lift[used], sd)),
        offset * [-1.0, -1.0, 1.0],
        covariance,
        _error_by_radius(angle.theta, covariance[:2, :2] / _offset_sd(motion) ** 2),
    )


def _error_by_radius(theta: Array, unseen: Array) -> Array:
    """Errors (n, 2) of corrected slip and lift per metre of the edge's radius beyond the planned one.

    With a larger radius the edge rolls farther, by theta per metre, and its centre line lies farther back and
    higher than the assumed one by as much. The correction has removed the part of this offset that the lift
    shows; `unseen` determines what is left.

    Args:
        theta: (n,) tipping angle [rad].
        unseen: (2, 2) covariance of the fitted offset, over its variance before the measurement.
    """
    left = unseen @ np.array([1.0, -1.0])
    return displacement_per_error(theta) @ np.append(left, 1.0)


def _offset_of_sliding_edge(theta: Array, lift: Array, sd: Array, offset_sd: float) -> tuple[Array, Array]:
    """Errors (3,) [m] of the assumed edge against the true, sliding one; their covariance (3, 3) [m^2].

    They are the offset at rest, horizontal in the direction of the tip, then upwards; and the radius, which
    sliding hides: 0 within 0.1 mm. The offset follows from the lift alone, with a prior of 0. An offset of
    three times `offset_sd` or more is taken for a real lift: then the prior itself is returned.

    Args:
        theta: (n,) tipping angle [rad].
        lift: (n,) height of the assumed edge over its position at rest [m].
        sd: (n,) standard deviation of the lift [m].
        offset_sd: standard deviation of the offset before the measurement [m].
    """
    errors, covariance = np.zeros(3), np.diag([offset_sd**2, offset_sd**2, _RADIUS_SD**2])
    if not len(theta):
        return errors, covariance
    on_table = np.abs(_lift_above_most(theta, lift, sd, offset_sd)) < _MAX_CREEP
    kept = on_table if np.count_nonzero(on_table) >= _NEIGHBOURS else np.ones(len(theta), dtype=bool)
    rows = displacement_per_offset(theta[kept])[None, :, 1]
    found = fit_creeping(theta[kept], rows, lift[None, kept], sd[kept], np.full(2, offset_sd))
    # An implausibly large offset is a lift: then the prior's offset is kept.
    if float(np.linalg.norm(found.parameters)) < _MAX_OFFSET_SIGMAS * offset_sd:
        errors[:2], covariance[:2, :2] = found.parameters, found.covariance
    return errors, covariance


def _offset_of_held_edge(theta: Array, slip: Array, lift: Array, sd: Array) -> tuple[Array, Array] | None:
    """Errors (3,) [m] of the assumed edge, if the true one stayed in place or rolled; their covariance.

    They are the offset of the followed point, where the edge was assumed to be on the object, along and off
    the table at rest, and the radius of the true edge beyond the assumed one; the covariance (3, 3) is in
    m^2. None if rotation about an edge that only rolls leaves more than 0.06 mm of slip or lift beyond noise,
    if its radius would be 2 mm off, or with fewer than ten frames. The offset may exceed three sd, for
    example with a tag whose place is unknown, or that is not printed to scale.

    Args:
        theta: (n,) tipping angle [rad].
        slip: (n,) displacement of the point along the table [m].
        lift: (n,) its displacement off the table [m].
        sd: (n,) standard deviation of slip and lift [m].
    """
    if len(theta) < 2 * _NEIGHBOURS:
        return None
    # Besides the three errors, a displacement along the table before the window.
    before = np.stack([np.ones_like(theta), np.zeros_like(theta)])[..., None]
    rows = np.concatenate([displacement_per_error(theta).transpose(1, 0, 2), before], axis=2)
    seen, prior = np.stack([slip, lift]), np.array([np.inf, np.inf, _HELD_RADIUS_SD, np.inf])
    weighted = np.concatenate([(rows / sd[:, None]).reshape(-1, 4), np.diag(1.0 / prior)])
    targets = np.concatenate([(seen / sd).ravel(), np.zeros(4)])
    found = np.asarray(np.linalg.lstsq(weighted, targets, rcond=None)[0], dtype=np.float64)
    unexplained = max(smooth_range(each, sd) for each in seen - rows @ found)
    if unexplained >= _MAX_UNEXPLAINED or abs(found[2]) > _MAX_RADIUS_ERROR:
        return None
    covariance = fit_creeping(theta, rows, seen, sd, prior).covariance
    return found[:3], covariance[:3, :3]


def smooth_range(values: Array, sd: Array) -> float:
    """Range (largest less least) of the running median over five values, less its noise; at least 0.

    The noise is four standard deviations of the difference of two such medians. The result has the unit of
    the values; 0 if there are fewer than five.

    Args:
        values: (n,) values, one per frame.
        sd: (n,) their standard deviations.
    """
    if len(values) < _NEIGHBOURS:
        return 0.0
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(values, _NEIGHBOURS), axis=1)
    # The sd of the median of five normal values is 0.536 of theirs.
    noise = 4.0 * math.sqrt(2.0) * 0.536 * float(np.median(sd))
    return max(0.0, float(np.ptp(smooth)) - noise)
