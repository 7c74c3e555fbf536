"""Strikes whose times a file states, and states so slow that nothing tips like that: would they be tips if all went faster?

Up to some ten times too slow a strike is read as it is, and its k says so (estimation/rate.py). Beyond that it is no tip at all to
whoever reads it: it seems to stand still after the blow, or to fall on for ever. Read again at the ratios that slow motion has, it is.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.motion.strike import analyse_strike
from analyze.motion.strike_task import StrikeTask
from schemas.result import Verdict

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.types import CameraModel, Marker, MarkerTrack, TipAngle, TipMotion

RATIOS = (8, 16, 32, 64)
"""true rate over the stated one: 240 frames a second, or 480, 960, 1920, that play at 30"""
NEAR = 4.0
"""times the k that the plan foretells, or as many times less: twice the rate would be four times"""
LEAST_TURN = math.radians(15.0)
"""of a motion that may be a tip"""
ROUGHLY = 2.5
"""times the ratio, or as many times less, that how long the motion takes may be off: nobody knows how hard the blow was"""
SPARE = 0.2
"""of the energy to the top"""
FALLEN = math.radians(50.0)
"""past the top: what a box turns until it lies"""
MOVED = math.radians(0.5)
FRAMES = 100
"""of a strike, that are read again"""


def ratio_of_a_tip(
    motion: TipMotion,
    tracks: Sequence[MarkerTrack],
    markers: Sequence[Marker],
    camera: CameraModel,
    task: StrikeTask,
    k_foretold: float,
) -> int | None:
    """By how much faster than its times say a strike must have been to be a tip; None where it is one, or is none at any ratio.

    Args:
        motion: as the stated times have it.
        tracks: the object's markers through the strike's window.
        markers: the object's markers.
        camera: with its place in W.
        task: the strike as planned and as carried out.
        k_foretold: rad/s^2, roughly.
    """
    if (
        motion.verdict is Verdict.GOOD
        or motion.angle is None
        or float(motion.angle.theta.max(initial=0.0)) < LEAST_TURN
    ):
        return None
    slower = _rise_s(motion.angle) / _tip_s(task.planned.phi_predicted_rad, k_foretold)
    off: dict[int, float] = {}
    for ratio in (each for each in RATIOS if each / ROUGHLY < slower < each * ROUGHLY):
        # A rolling shutter's rows are the image's, however slowly it plays: the corners are where they are already.
        again = analyse_strike(
            [_faster(track, ratio) for track in tracks], markers, camera, _task(task, ratio)
        )
        if again.verdict is Verdict.GOOD and again.fit is not None and again.fit.k:
            off[ratio] = abs(math.log(again.fit.k / k_foretold))
    best = min(off, key=lambda ratio: off[ratio], default=None)
    return best if best is not None and off[best] < math.log(NEAR) else None


def _rise_s(angle: TipAngle) -> float:
    """From the first of the motion to what is nearly its largest angle [s]."""
    theta = angle.theta
    end = int(np.argmax(theta >= 0.9 * float(theta.max())))
    start = int(np.flatnonzero(theta[: end + 1] <= MOVED)[-1]) if np.any(theta[: end + 1] <= MOVED) else 0
    return 1e-9 * float(angle.time_ns[end] - angle.time_ns[start])


def _tip_s(phi: float, k: float) -> float:
    """About as long takes a tip from rest to its fall [s]: over the top with a little to spare."""
    theta = np.linspace(0.0, phi + FALLEN, 200)
    rate = np.sqrt(2 * k * (SPARE * (1 - math.cos(phi)) + 1 - np.cos(phi - theta)))
    return float(np.trapezoid(1 / rate, theta))


def _faster(track: MarkerTrack, ratio: int) -> MarkerTrack:
    """Of fewer frames: whether it is a tip, and roughly its k, does not take all."""
    some = slice(None, None, max(1, len(track.time_ns) // FRAMES))
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
    end = None if task.images_end_ns is None else task.images_end_ns // ratio
    return replace(task, contact_time_ns=task.contact_time_ns // ratio, images_end_ns=end, unmarked_ns=None)


def true_rate(ratio: float, rate_hz: float) -> float:
    """Frames a second of a camera whose file states `rate_hz`: 29.97 is meant as 30."""
    usual = round(rate_hz)
    return ratio * (usual if abs(usual - rate_hz) < 2e-3 * rate_hz else rate_hz)


def slow_motion_text(ratio: float, rate_hz: float) -> str:
    """What is the matter, and what to do."""
    return (
        f"it tips as this object may only {ratio:g} times as fast as the {rate_hz:.4g} frames a second stated have it (slow motion?): "
        f"import again with --capture-fps {true_rate(ratio, rate_hz):g}"
    )
