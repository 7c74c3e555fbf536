"""Leave-one-out prediction of each recorded strike's motion from all others.

Predicted are the balance angle phi, the rate constant k of the motion and the tipping angle theta(t). A
plan's prediction of strikes not yet made is in planning/pivots.py (phi) and planning/examine.py (its sd).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from analyze.estimation.checks import SIGMAS
from analyze.estimation.joint import TWO_ERRORS_AS_ONE
from analyze.motion.predicted_motion import PredictedMotion, PredictedValues, predicted_motion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.checks import LeaveOneOut
    from analyze.pipeline.evidence import Evidence


@dataclass(frozen=True)
class StrikePrediction:
    """Measured motion of one strike compared with its prediction from all other strikes.

    Compared are the tipping angle theta over time, and balance angle phi and rate constant k [rad/s^2] of the
    motion theta'' = -k sin(phi - theta).
    """

    left_out: LeaveOneOut
    """balance angle phi and k, predicted and measured"""
    motion: PredictedMotion
    """tipping angle theta(t), predicted and measured"""

    @property
    def motion_sigmas(self) -> float:
        """Difference between measured and predicted tipping angle theta(t), in standard deviations.

        It is one number for two errors together, those of the balance angle and of k, the rate constant of
        the motion. It is scaled so that 3 is as unlikely by chance as an error of 3 sd of one quantity.
        """
        return TWO_ERRORS_AS_ONE * math.sqrt(self.motion.chi2)

    @property
    def consistent(self) -> bool:
        """True if a strike's measured motion is as predicted from all other strikes, within 3 sd.

        Judged are balance angle phi and rate constant k of the motion theta'' = -k sin(phi - theta) together,
        and the measured tipping angle theta over time.
        """
        return self.left_out.agrees and self.motion_sigmas <= SIGMAS


def predict_strikes(evidence: Evidence, left_out: Sequence[LeaveOneOut]) -> tuple[StrikePrediction, ...]:
    """Predict the tipping angle theta(t) of each strike from all others; compare it with the measured one.

    theta(t) follows theta'' = -k sin(phi - theta), with the balance angle phi [rad] and the rate k [rad/s^2]
    that the other strikes predict.

    Args:
        evidence: measured motions.
        left_out: predictions of phi and k, one per strike, by `checks.checked_left_out`.

    Returns:
        Comparisons of measured and predicted motion, in the order of `left_out`, without strikes that have no
        theta(t) or no fit, or that the others cannot check. k is scaled from gravity of the first recording
        to that of the strike's own.
    """
    motions = {motion.strike_id: motion for motion in evidence.motions}
    found: list[StrikePrediction] = []
    for each in left_out:
        motion = motions[each.strike_id]
        if motion.angle is None or motion.fit is None or not each.checkable:
            continue
        gravity_ratio = evidence.recording_of(each.strike_id).manifest.g_m_s2 / evidence.manifest.g_m_s2
        expected = PredictedValues(each.phi, each.k * gravity_ratio, each.by_others, each.own)
        found.append(
            StrikePrediction(each, predicted_motion(each.strike_id, motion.angle, motion.fit, expected))
        )
    return tuple(found)
