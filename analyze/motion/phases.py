"""Phases of a strike in theta(t): rest, impact (to t1), stage one, stage two (from t2), landing (t3).

theta(t) is the object's tipping angle. In stage one it slows down towards the balance angle, in stage two it
falls beyond it. The phases are those of VISAPP 2013, 3.2.1, Fig. 6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.types import Phases

if TYPE_CHECKING:
    from analyze.motion.settings import WindowLimits
    from analyze.types import Array, TipAngle

_MIN_MOVED_RAD = math.radians(0.15)
"""least theta [rad] of a moving object"""
_MAX_FRAME_GAP = 1.6
"""largest time between consecutive frames, in median frame intervals"""
_MEDIAN_REACH = 2
"""frames on either side of one in the running median of the turn about other axes"""
_MIN_STEP_S = 1 / 200
"""least time [s] between two frames whose difference gives a speed in the search for a landing"""


@dataclass(frozen=True)
class Course:
    """Events of a strike in its tipping angle theta(t): frames of first motion, release, top and end.

    Frames are given by index. The release is the frame from which only gravity acts.
    """

    moved_frame: int | None
    """first frame that is clearly off rest; None if the object did not move"""
    released_frame: int | None
    """first frame in which only gravity acts, some time after the impact; None if the object did not move"""
    top_frame: int | None
    """frame of the largest angle; None if the object did not move"""
    end_frame: int
    """first frame after the free motion: of the landing, of the return to rest, or past the window"""
    came_back: bool
    """True if the object returned to rest before it landed"""


def find_course(
    angle: TipAngle, contact_time_ns: int, limits: WindowLimits, landing_angle_rad: float | None = None
) -> Course:
    """Find first motion, release, top and end of a strike in its tipping angle theta(t).

    Args:
        angle: theta(t) of the whole window, resting frames first.
        contact_time_ns: time of the contact on the recording's clock (log_time) [ns], as the striker measured
            it; 0 if not known.
        limits: time left out after the impact, and theta below which the object counts as back at rest.
        landing_angle_rad: theta [rad] from which the shape's next face may touch, whether or not that slows
            the body; None if only theta(t) shows a landing.

    Returns:
        Index of the frame of each event; the end is the first frame after the free motion. All but the end
        are None if the object did not move.
    """
    theta, n = angle.theta, len(angle.theta)
    threshold = np.maximum(_MIN_MOVED_RAD, 6.0 * angle.sd)
    above = theta > threshold
    after = angle.time_ns > contact_time_ns - 20_000_000 if contact_time_ns else np.ones(n, dtype=bool)
    # Two frames in a row: one alone may be a wrong reading.
    moving = above & np.append(above[1:], False) & after
    if not np.any(moving):
        return Course(None, None, None, n, came_back=False)
    moved = int(np.argmax(moving))
    # The contact lies before the first moved frame, at most one frame and the time the threshold hides.
    struck = (
        max(moved, int(np.searchsorted(angle.time_ns, contact_time_ns, side="left")))
        if contact_time_ns
        else moved
    )
    until_ns = int(angle.time_ns[struck]) + round(1e9 * limits.guard_s)
    guarded = max(struck + limits.guard_frames, int(np.searchsorted(angle.time_ns, until_ns, side="left")))
    released = min(guarded, n - 1)
    # At high frame rates it may still be below that limit on its way up: it comes back only after it was
    # above.
    up = released + int(np.argmax(theta[released:] >= limits.above_rest))
    back = np.flatnonzero(theta[up:] < limits.above_rest)
    ended_back = up + int(back[0]) if len(back) else n
    landed = min(_landing(angle, released), _reached(angle, released, landing_angle_rad))
    ended = min(ended_back, landed)
    top = released + int(np.argmax(theta[released:ended])) if ended > released else released
    return Course(moved, released, top, ended, came_back=ended_back <= landed and len(back) > 0)


def _reached(angle: TipAngle, released: int, landing_angle_rad: float | None) -> int:
    """First frame at or beyond a landing angle; the number of frames if there is none.

    A single frame beyond the angle counts only if it is the last: otherwise it may be a wrong reading.

    Args:
        angle: tipping angle theta(t).
        released: first frame of the free motion, at which the search begins.
        landing_angle_rad: the angle [rad]; None gives the number of frames.
    """
    if landing_angle_rad is None:
        return len(angle.theta)
    past = angle.theta[released:] >= landing_angle_rad
    stays = np.flatnonzero(past & np.append(past[1:], True))
    return released + int(stays[0]) if len(stays) else len(angle.theta)


def _landing(angle: TipAngle, released: int) -> int:
    """Index of the frame at which a landing stops the body; the number of frames if none does.

    The search begins after frame `released`, where the free motion begins. A body is stopped if, beyond a
    tipping angle of 20 deg, it loses a third of an angular speed of over 1 rad/s between one frame and the
    next. A loss that had already begun does not count: on the way up gravity alone slows a small body as
    much. Above about 300 frames a second only every few frames are used, because the turn between neighbours
    would be within their errors.
    """
    every = (
        max(1, round(_MIN_STEP_S / max(1e-9 * float(np.median(np.diff(angle.time_ns))), 1e-6)))
        if len(angle.time_ns) > 1
        else 1
    )
    theta, sd, time_ns = angle.theta[::every], angle.sd[::every], angle.time_ns[::every]
    gap = np.maximum(np.diff(time_ns) * 1e-9, 1e-6)
    step = np.diff(theta) / gap
    whole = gap < _MAX_FRAME_GAP * float(np.median(gap)) if len(gap) else gap > 0
    released = -(-released // every)
    for i in range(max(released + 2, 2), len(step)):
        # Sense of rotation: +1 on the way up, -1 while falling back.
        way = math.copysign(1.0, float(np.median(step[max(released, i - 4) : i])))
        earlier, now = way * step[max(released, i - 4) : i], float(way * step[i])
        before = float(np.median(earlier))
        noise = 3.0 * float(sd[i]) / float(gap[i])
        # Across missing frames a loss of speed cannot be dated.
        followed = bool(np.all(whole[max(released, i - 4) : i + 1]))
        if (
            followed
            and before > 1.0 + noise
            and now < 0.66 * before - noise
            and theta[i] > math.radians(20.0)
        ):
            losing = (
                min(float(np.mean(np.diff(earlier))), 0.0) * (len(earlier) + 1) / 2
                if len(earlier) > 1
                else 0.0
            )
            if now < 0.66 * before + losing - noise:
                return i * every
    return len(angle.theta)


def free_window(
    angle: TipAngle, course: Course, phi: float, limits: WindowLimits, *, rolls: bool = False
) -> tuple[int, int]:
    """Frames [start, stop) in which only gravity acts in a plane: from release to 25 deg past balance.

    On a round rim it ends earlier where the object, past balance, has turned about other axes by 4 deg. If it
    lands or returns to rest first, the window ends one frame before this event; if the images end first, with
    them. (0, 0) if the object did not move. The angles are the defaults of `limits.past_phi` and `.off_axis`.

    Args:
        angle: tipping angle theta(t).
        course: events of the strike.
        phi: balance angle [rad].
        limits: bounds of the window.
        rolls: True if the edge is a round rim.
    """
    if course.released_frame is None:
        return 0, 0
    first = course.released_frame
    if first >= course.end_frame:
        return first, first
    theta = angle.theta[first : course.end_frame]
    past = theta > phi + limits.past_phi
    if rolls:
        padded = np.pad(angle.off_axis[first : course.end_frame], _MEDIAN_REACH, mode="edge")
        aside = np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * _MEDIAN_REACH + 1), axis=1)
        past |= (theta > phi) & (aside > limits.off_axis)
    # The frame before landing or coming back may be exposed while the contact begins.
    last = (
        first + int(np.argmax(past))
        if past.any()
        else (course.end_frame if course.end_frame == len(angle.theta) else course.end_frame - 1)
    )
    return first, max(first, last)


def phases_of(angle: TipAngle, course: Course, phi: float | None) -> Phases:
    """Frame ranges of a strike's phases; stage two begins at the first frame past the balance angle phi.

    Args:
        angle: tipping angle theta(t).
        course: events of the strike.
        phi: balance angle [rad]; None if unknown.

    Returns:
        Ranges [start, stop) of rest, strike, stage one, stage two and landing, each None if it did not occur;
        if the object did not move, all frames are rest.
    """
    n = len(angle.theta)
    if course.moved_frame is None or course.released_frame is None:
        return Phases((0, n), None, None, None, None)
    released, ended = course.released_frame, course.end_frame
    passed = np.flatnonzero(angle.theta[released:ended] >= phi) if phi is not None else np.zeros(0, dtype=int)
    t2 = released + int(passed[0]) if len(passed) else None
    return Phases(
        rest=(0, course.moved_frame) if course.moved_frame else None,
        strike=(course.moved_frame, released),
        stage_one=(released, t2 if t2 is not None else ended),
        stage_two=(t2, ended) if t2 is not None and t2 < ended else None,
        landing=(ended, n) if ended < n else None,
    )


def speed_jump(time: Array, residual: Array, sd: Array, omega_response: Array) -> tuple[int, float, float]:
    """Most likely jump in angular speed within a window: (index of frame, size [rad/s], drop of chi^2).

    A jump at frame i adds a ramp to the tipping angle theta. It is taken as linear in time, which holds for
    the few frames that determine it. (0, 0, 0) if no jump reduces chi^2.

    Args:
        time: (n,) times of the frames [s].
        residual: (n,) residuals of a fit without a jump [rad].
        sd: (n,) standard deviations of theta [rad].
        omega_response: (n, p) derivatives of theta by the fitted parameters, which absorb part of a jump.
    """
    n = len(time)
    basis = omega_response / sd[:, None]
    q, _ = np.linalg.qr(basis)
    r = residual / sd
    best = (0, 0.0, 0.0)
    for i in range(1, n - 4):
        ramp = np.maximum(time - time[i], 0.0) / sd
        ramp = ramp - q @ (q.T @ ramp)
        power = float(ramp @ ramp)
        if power <= 0:
            continue
        size = float(ramp @ r) / power
        gain = size * size * power
        if gain > best[2]:
            best = (i, size, gain)
    return best
