"""Restitution at a landing: speed of the line that lands, after over before it meets the table.

A body that tips about one edge lands when its next face comes to the table: the far end of that face, a line
at the distance L from the edge about which it turned, meets the table with the speed L theta'. The height of
this line over the table follows, near the landing, from the measured angle and height of the edge. Before and
after the landing it is a parabola; the two meet at the instant of the landing, on the table. The coefficient
of restitution is the ratio of its slopes there (Newton). It belongs to this line of this body on this table:
a body that lands on one end of a face turns about it, also where nothing rebounds.
"""

# scipy and numpy are only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportUnknownMemberType=false

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

if TYPE_CHECKING:
    from analyze.types import Array, EdgePath, TipAngle

_BEFORE = 6
"""frames before the landing that are used"""
_LONGEST_AFTER_S = 0.12
"""time after the landing that is used at most [s]"""
_FALL_SHARE, _FALL_SHARE_SD = 1.15, 0.25
"""fall of the line after the landing over gravity, and its standard deviation, for a body that hardly turns:
1 in the air, up to 1.5 while it still turns about its edge"""
_CLEAR_M = 5e-4
"""least height [m] of other lines over the table in the frames that are used"""
_MIN_AFTER = 3
"""least number of frames between the landing and the next contact"""
_SAME_FLIGHT = 0.85
"""share of the time until the line is expected to land again whose frames are used"""
_MIN_SPEED = 0.1
"""least speed of the line before the landing [m/s]"""
_HEIGHT_SD = 2e-5
"""error of a frame's height by lens and contact [m], beyond the stated one"""
_PLANE_SD = 0.014
"""error of a ratio of speeds by the ends of the line, which do not land at the same instant, and by the other
edge, which trembles: 0.010 in the median of 92 simulated landings"""
_TURNS_ON = 0.5
"""angular speed after over before from which a body turns on over the line that landed: the frames then show
that turn, not the rebound"""
_MAX_GAP = 2.5
"""longest time between frames across the landing, in median intervals"""
_SIGMAS = 1.96


@dataclass(frozen=True)
class LandingBody:
    """Lines of a body that may land, and its centre of mass: places [m] from the edge about which it tips.

    A place is horizontal in the direction of tipping and upwards, at rest, from the centre line of the
    edge's rounding; all lines have that rounding.
    """

    line: Array
    """(2,) the line that lands next"""
    others: Array
    """(m, 2) lines that may land after it"""
    com: Array
    """(2,) centre of mass"""


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
    angle: TipAngle, path: EdgePath, body: LandingBody, last_free: int, gravity: float
) -> Landing | None:
    """Restitution at the landing of a strike; None if too few frames show it before the next contact.

    Args:
        angle: theta(t) of the strike, through the landing.
        path: height of the edge in the same frames.
        body: the line that lands, and others.
        last_free: last frame known to be before the landing.
        gravity: gravity [m/s^2].
    """
    first = max(last_free - _BEFORE + 1, 0)
    last = int(np.searchsorted(angle.time_ns, angle.time_ns[last_free] + round(1e9 * _LONGEST_AFTER_S)))
    used = np.arange(first, min(last, len(angle.theta)))
    theta = angle.theta[used]
    if len(body.others):
        low = np.min(path.lift[used, None] + _height(body.others, theta), axis=1) < _CLEAR_M
        low[: last_free - first + 1] = False
        used = used[: int(np.argmax(low))] if np.any(low) else used
        theta = angle.theta[used]
    if len(used) < _BEFORE + _MIN_AFTER:
        return None
    time = (angle.time_ns[used] - angle.time_ns[last_free]) * 1e-9
    # Linear in the angle about the landing: a chord's curvature would pass for a change of speed.
    lands = math.atan2(body.line[1], body.line[0])
    lands -= math.pi * round((lands - float(theta[last_free - first])) / math.pi)
    by_theta = float(-body.line[0] * math.cos(lands) - body.line[1] * math.sin(lands))
    height = path.lift[used] + by_theta * (theta - lands)
    by = np.tile([by_theta, 0.0, 1.0], (len(used), 1))
    variance = np.einsum("ni,nij,nj->n", by, path.covariance[used], by) + _HEIGHT_SD**2
    above = float(_height(body.com[None], theta[last_free - first : last_free - first + 1])[0, 0])
    frames = _Frames(time, height, np.sqrt(variance), theta, above, gravity)
    return _fitted(frames, int(angle.time_ns[last_free]))


def _height(places: Array, theta: Array) -> Array:
    """Height (n, m) [m] over the edge of lines at places (m, 2), in a body turned by theta (n,)."""
    return -np.outer(np.sin(theta), places[:, 0]) + np.outer(np.cos(theta), places[:, 1])


@dataclass(frozen=True)
class _Frames:
    """Frames about a landing; those up to time 0 precede it."""

    time: Array
    """(n,) [s]"""
    height: Array
    """(n,) of the line over the table [m]"""
    sd: Array
    """(n,) its standard deviation [m]"""
    theta: Array
    """(n,) tipping angle [rad]"""
    above: float
    """height of the centre of mass over the table at the landing [m]"""
    gravity: float
    """[m/s^2]"""

    def until(self, count: int) -> _Frames:
        """The first `count` frames."""
        return replace(
            self,
            time=self.time[:count],
            height=self.height[:count],
            sd=self.sd[:count],
            theta=self.theta[:count],
        )


def _fitted(frames: _Frames, origin_ns: int) -> Landing | None:
    """Landing from the frames about it; None if they do not show it."""
    time, step = frames.time, float(np.median(np.diff(frames.time)))
    before = _before(frames)
    if (
        before is None
        or before + _MIN_AFTER > len(time)
        or np.any(np.diff(time[: before + 3]) > _MAX_GAP * step)
    ):
        return None
    fall = np.polynomial.polynomial.polyfit(
        time[:before], frames.height[:before], 2, w=1 / frames.sd[:before]
    )
    count, found = before + 2, None
    while count <= len(time):
        trial = _kinked(frames.until(count), before, np.asarray(fall, dtype=np.float64))
        flight = time[count - 1] - trial[0][0] <= _SAME_FLIGHT * trial[0][3] / max(-trial[0][5], 1e-3)
        if found is None or flight:
            found = trial
        if not flight:
            break
        count += 1
    if found is None or -found[0][2] < _MIN_SPEED:
        return None
    return _landing_of(found, frames, before, origin_ns)


def _before(frames: _Frames) -> int | None:
    """Number of frames before the landing: as many as continue the fall; None if none comes after it."""
    time, height, sd = frames.time, frames.height, frames.sd
    count = int(np.searchsorted(time, 0.0, side="right"))
    while count < len(time):
        fall = np.polynomial.polynomial.polyfit(time[:count], height[:count], 2, w=1 / sd[:count])
        expected = float(np.polynomial.polynomial.polyval(time[count], fall))
        speed = abs(float(fall[1] + 2 * fall[2] * time[count]))
        margin = 8 * float(sd[count]) + 0.05 * speed * float(time[count] - time[count - 1])
        if height[count] - expected > margin:
            return count
        count += 1
    return None


def _kinked(frames: _Frames, before: int, fall: Array) -> tuple[Array, Array]:
    """Parameters (6,) of two parabolas that meet at the landing, with covariance (6, 6).

    They are the time of the landing [s], the height there [m], the slopes before and after [m/s], and half
    the second derivatives before and after [m/s^2].
    """
    time, height, sd = frames.time, frames.height, frames.sd
    guess = float(0.5 * (time[before - 1] + time[before]))
    value = float(np.polynomial.polynomial.polyval(guess, fall))
    slope = float(fall[1] + 2 * fall[2] * guess)
    rise = float((height[-1] - value) / max(time[-1] - guess, 1e-6))
    # A line below the centre of mass of a turning body is drawn up towards it.
    omega = float(np.polyfit(time[before:], frames.theta[before:], 1)[0])
    drawn_up = omega * omega * frames.above
    late_mean = -0.5 * (frames.gravity * _FALL_SHARE - drawn_up)
    late_sd = 0.5 * np.hypot(frames.gravity * _FALL_SHARE_SD, 0.3 * drawn_up)
    start = np.array([guess, value, slope, rise, fall[2], late_mean])

    def residual(x: Array) -> Array:
        """Heights less those of the two parabolas, in standard deviations, and the prior of the second."""
        since = time - x[0]
        own = np.where(since < 0, x[2] * since + x[4] * since**2, x[3] * since + x[5] * since**2)
        return np.concatenate([(height - x[1] - own) / sd, [(x[5] - late_mean) / late_sd]])

    bounds = np.full((2, 6), [[-np.inf], [np.inf]])
    bounds[:, 0] = time[before - 1] - 1e-9, time[before] + 1e-9
    found = least_squares(residual, start, bounds=bounds, x_scale=[1e-3, 1e-4, 1.0, 1.0, 5.0, 5.0])
    J = np.asarray(found.jac)
    covariance = np.linalg.pinv(J.T @ J, rcond=1e-14, hermitian=True)
    return np.asarray(found.x), np.asarray(covariance)


def _landing_of(found: tuple[Array, Array], frames: _Frames, before: int, origin_ns: int) -> Landing | None:
    (x, covariance), time, theta = found, frames.time, frames.theta
    ratio = -float(x[3] / x[2])
    by = np.array([0.0, 0.0, x[3] / x[2] ** 2, -1 / x[2], 0.0, 0.0])
    own = float(np.sqrt(by @ covariance @ by))
    first = slice(max(before - 5, 0), before)
    omega_before = float(np.polyfit(time[first], theta[first], 2)[:2] @ [2 * x[0], 1.0])
    after = slice(before, before + _MIN_AFTER)
    omega_after = float(np.polyfit(time[after], theta[after], 1)[0])
    if omega_after > _TURNS_ON * omega_before > 0 or omega_after < _TURNS_ON * omega_before < 0:
        return None
    landed_ns = origin_ns + round(1e9 * float(x[0]))
    # A rebound that is over before the second frame after the landing is not resolved.
    hidden = frames.gravity * _FALL_SHARE * float(time[before + 1] - x[0]) / 2 / -float(x[2])
    spread = float(np.hypot(own, _PLANE_SD))
    upper = None
    if ratio < max(hidden, _SIGMAS * own):
        upper = max(hidden, ratio + _SIGMAS * own, 0.0)
        ratio, spread = upper / 2, upper / np.sqrt(12)
    return Landing(ratio, spread, upper, -float(x[2]), omega_before, omega_after, landed_ns)
