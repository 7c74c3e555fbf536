"""Restitution at a landing: speed of the line that lands, after over before it meets the table.

A body that tips about one edge lands when its next face comes to the table: the far end of that face, a line
at the distance L from the edge about which it turned, meets the table with the speed L theta'. The height of
this line over the table follows from the measured angle and the measured height of the edge. Before and after
the landing it is a parabola; the two meet at the instant of the landing, on the table. The coefficient of
restitution is the ratio of its slopes there (Newton). It belongs to this line of this body on this table: a
body that lands on one end of a face turns about it, also where nothing rebounds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

if TYPE_CHECKING:
    from analyze.types import Array, EdgePath, TipAngle

_BEFORE = 7
"""frames before the landing that are used"""
_LONGEST_AFTER_S = 0.12
"""time after the landing that is used at most [s]"""
_FALL_SHARE, _FALL_SHARE_SD = 1.15, 0.25
"""fall of the line after the landing over gravity, and its standard deviation: 1 in the air, up to 1.5 while
the body still turns about its edge"""
_SAME_FLIGHT = 0.85
"""share of the time until the line is expected to land again whose frames are used"""
_MIN_SPEED = 0.1
"""least speed of the line before the landing [m/s]"""
_HEIGHT_SD = 2e-5
"""error of a frame's height by lens and contact [m], beyond the stated one"""
_SPEED_SHARE_SD = 0.003
"""error of a ratio of speeds by the frames' times and the camera's strain, over 1"""
_MAX_GAP = 2.5
"""longest time between frames across the landing, in median intervals"""
_SIGMAS = 1.96


@dataclass(frozen=True)
class LandingLine:
    """Line of a body that lands next, seen from the edge about which it tips."""

    angle: float
    """tipping angle [rad] at which the face between the two lies on the table"""
    distance: float
    """distance [m] from the edge at the landing, positive in the direction of tipping"""


@dataclass(frozen=True)
class Landing:
    """One measured landing."""

    restitution: float
    """speed of the line after over that before; half of the upper limit if no rebound is resolved"""
    sd: float
    """its standard deviation"""
    upper: float | None
    """upper limit (95 %) where the frames resolve no rebound; None where they do"""
    speed: float
    """speed of the line as it meets the table [m/s]"""
    omega_before: float
    """angular speed before [rad/s]"""
    omega_after: float
    """angular speed after [rad/s]"""
    time_ns: int
    """log_time of the landing [ns]"""


def landing(
    angle: TipAngle, path: EdgePath, line: LandingLine, last_free: int, gravity: float
) -> Landing | None:
    """Restitution at the landing of a strike; None if no frames show it.

    Args:
        angle: theta(t) of the strike, through the landing.
        path: height of the edge in the same frames.
        line: the line that lands.
        last_free: last frame known to be before the landing.
        gravity: gravity [m/s^2].
    """
    first = max(last_free - _BEFORE + 1, 0)
    last = int(np.searchsorted(angle.time_ns, angle.time_ns[last_free] + round(1e9 * _LONGEST_AFTER_S)))
    used = np.arange(first, min(last, len(angle.theta)))
    if len(used) < _BEFORE + 1:
        return None
    time = (angle.time_ns[used] - angle.time_ns[last_free]) * 1e-9
    theta = angle.theta[used]
    height = path.lift[used] - line.distance * np.sin(theta - line.angle)
    by = np.stack([-line.distance * np.cos(theta - line.angle), np.zeros(len(used)), np.ones(len(used))], -1)
    variance = np.einsum("ni,nij,nj->n", by, path.covariance[used], by) + _HEIGHT_SD**2
    return _fitted(time, height, np.sqrt(variance), theta, gravity, int(angle.time_ns[last_free]))


def _fitted(
    time: Array, height: Array, sd: Array, theta: Array, gravity: float, origin_ns: int
) -> Landing | None:
    """Landing from heights (n,) [m] of the line with their sd; frames up to time 0 precede it."""
    step = float(np.median(np.diff(time)))
    before = _before(time, height, sd)
    if before is None or np.any(np.diff(time[: before + 3]) > _MAX_GAP * step):
        return None
    fall = np.polynomial.polynomial.polyfit(time[:before], height[:before], 2, w=1 / sd[:before])
    count, found = before + 2, None
    while count <= len(time):
        trial = _kinked(time[:count], height[:count], sd[:count], before, fall, gravity)
        if trial is None:
            return None
        speed_after = trial[0][3]
        landed, again = trial[0][0], 2 * max(speed_after, 0.0) / (gravity * _FALL_SHARE)
        if found is not None and time[count - 1] - landed > _SAME_FLIGHT * again:
            break
        found = trial
        if time[count - 1] - landed > _SAME_FLIGHT * again:
            break
        count += 1
    if found is None or -found[0][2] < _MIN_SPEED:
        return None
    return _landing_of(found, time, theta, sd, before, gravity, step, origin_ns)


def _before(time: Array, height: Array, sd: Array) -> int | None:
    """Number of frames before the landing: as many as continue the fall; None if none comes after it."""
    count = int(np.searchsorted(time, 0.0, side="right"))
    while count < len(time):
        fall = np.polynomial.polynomial.polyfit(time[:count], height[:count], 2, w=1 / sd[:count])
        expected = float(np.polynomial.polynomial.polyval(time[count], fall))
        speed = abs(float(fall[1] + 2 * fall[2] * time[count]))
        if height[count] - expected > 8 * float(sd[count]) + 0.05 * speed * float(time[count] - time[count - 1]):
            return count
        count += 1
    return None


def _kinked(
    time: Array, height: Array, sd: Array, before: int, fall: Array, gravity: float
) -> tuple[Array, Array] | None:
    """Parameters (6,) of two parabolas that meet at the landing, with covariance (6, 6); None without a fit.

    They are the time of the landing [s], the height there [m], the slopes before and after [m/s], and half
    the second derivatives before and after [m/s^2].
    """
    at = float(time[before - 1])
    guess = float(0.5 * (time[before - 1] + time[before]))
    slope = float(fall[1] + 2 * fall[2] * guess)
    late = time[before:]
    rise = float((height[-1] - np.polynomial.polynomial.polyval(guess, fall)) / max(late[-1] - guess, 1e-6))
    start = np.array(
        [guess, float(np.polynomial.polynomial.polyval(guess, fall)), slope, rise, fall[2], -gravity / 2]
    )
    late_mean, late_sd = -0.5 * gravity * _FALL_SHARE, 0.5 * gravity * _FALL_SHARE_SD

    def residual(x: Array) -> Array:
        since = time - x[0]
        own = np.where(since < 0, x[2] * since + x[4] * since**2, x[3] * since + x[5] * since**2)
        return np.concatenate([(height - x[1] - own) / sd, [(x[5] - late_mean) / late_sd]])

    bounds = np.full((2, 6), [[-np.inf], [np.inf]])
    bounds[:, 0] = at - 1e-9, float(time[before]) + 1e-9
    start[0] = min(max(start[0], bounds[0, 0]), bounds[1, 0])
    found = least_squares(residual, start, bounds=bounds, x_scale=[1e-3, 1e-4, 1.0, 1.0, 5.0, 5.0])
    J = np.asarray(found.jac)
    covariance = np.linalg.pinv(J.T @ J, rcond=1e-14, hermitian=True)
    return np.asarray(found.x), np.asarray(covariance)


def _landing_of(
    found: tuple[Array, Array],
    time: Array,
    theta: Array,
    sd: Array,
    before: int,
    gravity: float,
    step: float,
    origin_ns: int,
) -> Landing:
    x, covariance = found
    ratio = -float(x[3] / x[2])
    by = np.array([0.0, 0.0, x[3] / x[2] ** 2, -1 / x[2], 0.0, 0.0])
    own = float(np.sqrt(by @ covariance @ by))
    first = slice(max(before - 5, 0), before)
    omega_before = float(np.polyfit(time[first], theta[first], 2)[:2] @ [2 * x[0], 1.0])
    after = slice(before, min(before + 3, len(time)))
    omega_after = float(np.polyfit(time[after], theta[after], 1)[0]) if before + 1 < len(time) else 0.0
    # A rebound that is over before the second frame after the landing is not resolved.
    until = float(time[min(before + 1, len(time) - 1)] - x[0])
    hidden = gravity * _FALL_SHARE * until / 2 / -float(x[2])
    landed_ns = origin_ns + round(1e9 * float(x[0]))
    if ratio < max(hidden, _SIGMAS * own):
        upper = max(hidden, ratio + _SIGMAS * own, 0.0)
        return Landing(
            upper / 2, upper / np.sqrt(12), upper, -float(x[2]), omega_before, omega_after, landed_ns
        )
    spread = float(np.hypot(own, _SPEED_SHARE_SD * ratio))
    return Landing(ratio, spread, None, -float(x[2]), omega_before, omega_after, landed_ns)
