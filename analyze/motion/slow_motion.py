"""True frame rate of slow-motion videos, found by analysing strikes at the usual slow-motion ratios.

If the stated times are up to about ten times too slow, a strike is analysed as it is, and the rate k
[rad/s^2] of its tip, which scales with the square of the frame rate, shows the ratio (estimation/rate.py).
Beyond that the motion is not a tip by the stated times: the object seems to stand still after the impact, or
to fall without end. At the right ratio it is a tip.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.strike import analyse_strike
from analyze.motion.strike_task import StrikeTask
from schemas.strike_result import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.types import CameraModel, Marker, MarkerTrack, TipAngle, TipMotion

RATE_RATIOS = (8, 16, 32, 64)
"""true frame rate over the stated one: 240, 480, 960 or 1920 frames a second that play at 30"""
MAX_K_RATIO = 4.0
"""largest ratio of k to the predicted one, either way; twice the frame rate makes k four times as large"""
MIN_TURN_RAD = math.radians(15.0)
"""least turn of a motion that may be a tip [rad]"""
MAX_DURATION_RATIO = 2.5
"""largest ratio of the motion's duration to the expected one, either way; the impact's strength is unknown"""
SPARE_ENERGY = 0.2
"""assumed kinetic energy at the top, over the energy needed to reach the top"""
FALL_RAD = math.radians(50.0)
"""rotation of a box from the top until it lies [rad]"""
MOVED_RAD = math.radians(0.5)
"""least theta of a moving object [rad]"""
MAX_FRAMES = 100
"""approximate number of frames of a strike that are analysed again"""


def slow_motion_ratio(
    motion: TipMotion,
    tracks: Sequence[MarkerTrack],
    markers: Sequence[Marker],
    camera: CameraModel,
    task: StrikeTask,
    k_predicted: float,
) -> int | None:
    """Ratio of true to stated frame rate at which the motion of a strike is a tip, or None.

    Tried are those of the ratios 8, 16, 32 and 64 at which the object's rise takes 0.4 to 2.5 times the time
    expected from `k_predicted`. None if the motion is a clean tip at the stated rate, if it has no tipping
    angle or turned by less than 15 deg, or if at none of these ratios it is a clean tip with a k within a
    factor of 4 of `k_predicted`.

    Args:
        motion: motion by the stated times.
        tracks: the object's markers through the strike's window.
        markers: the object's markers.
        camera: camera with its pose in the world frame W.
        task: the strike as planned and as carried out.
        k_predicted: rough prediction of the rate k of the tip [rad/s^2], k = m g R / I_edge with mass m,
            gravity g, distance R of the centre of mass from the edge, and moment of inertia I_edge about it.
    """
    if (
        motion.verdict is Verdict.GOOD
        or motion.angle is None
        or float(motion.angle.theta.max(initial=0.0)) < MIN_TURN_RAD
    ):
        return None
    slower = _rise_time_s(motion.angle) / _tip_time_s(task.planned.phi_predicted_rad, k_predicted)
    off: dict[int, float] = {}
    for ratio in (
        each for each in RATE_RATIOS if each / MAX_DURATION_RATIO < slower < each * MAX_DURATION_RATIO
    ):
        # The rolling shutter has been corrected in the images already, whatever their times.
        again = analyse_strike(
            [_faster(track, ratio) for track in tracks], markers, camera, _task(task, ratio)
        )
        if again.verdict is Verdict.GOOD and again.fit is not None and again.fit.k:
            off[ratio] = abs(math.log(again.fit.k / k_predicted))
    best = min(off, key=lambda ratio: off[ratio], default=None)
    return best if best is not None and off[best] < math.log(MAX_K_RATIO) else None


def _rise_time_s(angle: TipAngle) -> float:
    """Time [s] in which the tipping angle rises from 0.5 deg to 90 % of its largest value.

    It is taken from the frames' stated times, which in slow motion are longer than the true ones.
    """
    theta = angle.theta
    end = int(np.argmax(theta >= 0.9 * float(theta.max())))
    start = np.max(np.flatnonzero(theta[: end + 1] <= MOVED_RAD), initial=0)
    return 1e-9 * float(angle.time_ns[end] - angle.time_ns[start])


def _tip_time_s(phi: float, k: float) -> float:
    """Approximate duration [s] of a tip from rest to its fall, over the top with a little energy to spare.

    Args:
        phi: balance angle [rad].
        k: rate [rad/s^2] of theta'' = -k sin(phi - theta), theta the tipping angle.
    """
    theta = np.linspace(0.0, phi + FALL_RAD, 200)
    rate = np.sqrt(2 * k * (SPARE_ENERGY * (1 - math.cos(phi)) + 1 - np.cos(phi - theta)))
    return float(np.trapezoid(1 / rate, theta))


def _faster(track: MarkerTrack, ratio: int) -> MarkerTrack:
    """Marker track with its times divided by `ratio`, thinned to fewer than 200 frames if it has more.

    So the track has the times that it would have if the camera were `ratio` times as fast. Few frames suffice
    for a verdict and a rough k, the rate constant of the tip.
    """
    some = slice(None, None, max(1, len(track.time_ns) // MAX_FRAMES))
    return replace(
        track,
        time_ns=track.time_ns[some] // ratio,
        corners_px=track.corners_px[some],
        corner_sd_px=track.corner_sd_px[some],
        R_camera_marker=track.R_camera_marker[some],
        p_camera_marker=track.p_camera_marker[some],
        late_ns=None if track.late_ns is None else track.late_ns[some] // ratio,
    )


def _task(task: StrikeTask, ratio: int) -> StrikeTask:
    """Copy of a strike's plan and times [ns] with the times divided by `ratio`.

    `ratio` is the true over the stated frame rate. The times of images in which no marker was found are left
    out.
    """
    end = None if task.images_end_ns is None else task.images_end_ns // ratio
    return replace(task, contact_time_ns=task.contact_time_ns // ratio, images_end_ns=end, unmarked_ns=None)


def true_rate(ratio: float, rate_hz: float) -> float:
    """True frame rate [Hz] of a file that states `rate_hz`, with 29.97 taken as 30.

    Args:
        ratio: true over stated frame rate.
        rate_hz: stated frame rate [Hz]; a rate within 0.2 % of a whole number is taken as that number.
    """
    usual = round(rate_hz)
    return ratio * (usual if abs(usual - rate_hz) < 2e-3 * rate_hz else rate_hz)


def slow_motion_text(ratio: float, rate_hz: float) -> str:
    """Message that a video seems to be slow motion, with the option that corrects the import.

    Args:
        ratio: true over stated frame rate.
        rate_hz: stated frame rate [Hz].
    """
    return (
        f"the motion is a tip of this object only if the true frame rate is {ratio:g} times"
        f" the stated {rate_hz:.4g} frames a second (slow motion?): "
        f"import again with --capture-fps {true_rate(ratio, rate_hz):g}"
    )
