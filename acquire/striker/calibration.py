"""Calibration of a striker by swings in the air and at bodies of known mass.

The results are swing ratio (reached over commanded tip speed), effective mass of the tip and restitution.
They enter the energy of a strike (section 1.5 of docs/explanation/method.md).

A tip of effective mass m_s that meets a free body of mass m_b at speed v loses the speed
dv = (1 + e)*v / (1 + m_s/m_b), with e the coefficient of restitution. A light body (m_b far below m_s)
determines (1 + e)/m_s, a heavy one or a wall 1 + e: both together determine m_s and e. Swings in the air
determine neither.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

COMMON_DROP_SD = 0.05
"""relative error common to all speed losses: the servo pushes on during the contact and measures the rebound
late"""
MIN_SPEED_SD = 0.002
"""smallest relative standard deviation of a tip speed: the resolution of the velocity register"""
MIN_MASS_SD_KG, MIN_RESTITUTION_SD = 1e-4, 1e-3
"""lower limits of the prior's standard deviations of effective mass [kg] and restitution"""
MAX_ITERATIONS, DIFFERENCE_STEP = 20, 1e-5
"""Gauss-Newton: largest number of iterations; step of the numerical derivatives, in natural logarithms"""


@dataclass(frozen=True)
class MeasuredSwing:
    """One calibration swing in the air or at a body: commanded and reached tip speed, and its loss [m/s].

    The loss of tip speed is that at the contact with the body, whose mass [kg] is given too. In the air both
    are None; the loss is also None if it was not significant. Reached speed and loss have standard
    deviations.
    """

    command_m_s: float
    """commanded tip speed [m/s]"""
    speed_m_s: float
    """reached tip speed [m/s]"""
    speed_sd_m_s: float
    """standard deviation of the reached tip speed [m/s]"""
    drop_m_s: float | None = None
    """loss of tip speed at contact [m/s]; None if it was not significant"""
    drop_sd_m_s: float = 0.0
    """standard deviation of the loss [m/s]; without meaning if the loss is None"""
    body_kg: float | None = None
    """mass of the free body that was struck [kg]; None in the air, infinite for a wall"""


@dataclass(frozen=True)
class SwingRatio:
    """Ratio of reached to commanded tip speed: mean, its standard deviation, scatter between swings.

    The scatter is the standard deviation of the ratio of a single swing.
    """

    mean: float
    """mean over the swings, weighted by inverse variance"""
    mean_sd: float
    """standard deviation of the mean"""
    scatter: float
    """standard deviation between swings; 0 for a single swing"""


@dataclass(frozen=True)
class StrikerParameters:
    """Effective mass [kg] and coefficient of restitution of the striker's tip, with standard deviations."""

    effective_mass_kg: float
    """effective mass of the tip [kg]: the arm's moment of inertia about its axis, over its length squared"""
    effective_mass_sd_kg: float
    """standard deviation of the effective mass [kg]"""
    restitution: float
    """coefficient of restitution e of tip and object, 0-1"""
    restitution_sd: float
    """standard deviation of the restitution"""


def swing_ratio(swings: Sequence[MeasuredSwing]) -> SwingRatio:
    """Ratio of reached to commanded tip speed: mean with standard deviation, and scatter of the swings.

    The mean is weighted by inverse variance. Its standard deviation is the larger of two: that from the
    scatter between swings, and that from the standard deviations of the swings' speeds. The scatter is the
    standard deviation of single swings, 0 for one swing.

    Args:
        swings: at least one swing, in the air or at a body.
    """
    ratio = np.array([each.speed_m_s / each.command_m_s for each in swings])
    sd = np.array([max(each.speed_sd_m_s / each.command_m_s, MIN_SPEED_SD) for each in swings])
    weight = sd**-2 / np.sum(sd**-2)
    mean = float(weight @ ratio)
    scatter = math.sqrt(float(weight @ (ratio - mean) ** 2) * len(ratio) / max(len(ratio) - 1, 1))
    mean_sd = max(scatter / math.sqrt(len(ratio)), math.sqrt(1 / float(np.sum(sd**-2))))
    return SwingRatio(mean, mean_sd, scatter)


def estimate_striker(prior: StrikerParameters, swings: Sequence[MeasuredSwing]) -> StrikerParameters:
    """Posterior of a striker's effective mass m_s and coefficient of restitution e, from swings at bodies.

    Unknowns: ln m_s, ln(1 + e) and a relative error that the speed losses of all swings share. They are
    found by Gauss-Newton steps that begin at the prior.

    Args:
        prior: m_s [kg] and e before the swings, with standard deviations, e.g. those of the rig file.
        swings: swings in any order. Those at a body with a positive loss of speed count; those in the air,
            and those whose loss is None (not significant), do not.

    Returns:
        m_s [kg] and e with their standard deviations, e limited to 0-1; `prior` itself (not a copy) if no
        swing counts.
    """
    hits = [
        each
        for each in swings
        if each.body_kg is not None and each.drop_m_s is not None and each.drop_m_s > 0
    ]
    if not hits:
        return prior
    log_loss = np.array([math.log((each.drop_m_s or 0.0) / each.speed_m_s) for each in hits])
    sd = np.array(
        [
            math.hypot(each.drop_sd_m_s / (each.drop_m_s or 1.0), each.speed_sd_m_s / each.speed_m_s)
            for each in hits
        ]
    )
    inverse_mass = np.array([1 / (each.body_kg or math.inf) for each in hits])
    prior_sd = np.array(
        [
            max(prior.effective_mass_sd_kg, MIN_MASS_SD_KG) / prior.effective_mass_kg,
            max(prior.restitution_sd, MIN_RESTITUTION_SD) / (1 + prior.restitution),
            COMMON_DROP_SD,
        ]
    )
    prior_mean = np.array([math.log(prior.effective_mass_kg), math.log1p(prior.restitution), 0.0])

    def residual(
        x: np.ndarray[tuple[int], np.dtype[np.float64]],
    ) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        predicted = x[1] + x[2] - np.log1p(np.exp(x[0]) * inverse_mass)
        return np.concatenate(
            [(predicted - log_loss) / np.maximum(sd, MIN_SPEED_SD), (x - prior_mean) / prior_sd]
        )

    x = prior_mean.copy()
    covariance = np.diag(prior_sd**2)
    for _ in range(MAX_ITERATIONS):
        now = residual(x)
        jacobian = np.stack(
            [(residual(x + DIFFERENCE_STEP * unit) - now) / DIFFERENCE_STEP for unit in np.eye(3)], axis=-1
        )
        covariance = np.linalg.inv(jacobian.T @ jacobian)
        step = covariance @ (jacobian.T @ now)
        x = x - step
        if float(np.abs(step).max()) < 1e-6:
            break
    mass, rebound = math.exp(float(x[0])), math.exp(float(x[1]))
    mass_sd, rebound_sd = (
        mass * math.sqrt(float(covariance[0, 0])),
        rebound * math.sqrt(float(covariance[1, 1])),
    )
    return StrikerParameters(mass, mass_sd, min(max(rebound - 1, 0.0), 1.0), rebound_sd)
