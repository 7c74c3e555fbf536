"""What swings of a bare striker say of it: reached over commanded tip speed, effective mass and restitution (METHOD.md 1.5).

A tip of effective mass m_s that meets a free body of mass m_b at speed v loses the speed dv = (1 + e)*v / (1 + m_s/m_b). A light body
(m_b far below m_s) tells (1 + e)/m_s, a heavy one (or a wall) 1 + e: only both tell them apart. Swings in the air tell nothing of either.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

DROP_SD = 0.05
"""relative, of every drop alike: the servo pushes on during the touch, and feels the rebound late"""
LEAST_SPEED_SD = 0.002
"""relative, of a tip speed: the rounding of the velocity register, at least"""
LEAST_MASS_SD, LEAST_RESTITUTION_SD = 1e-4, 1e-3
STEPS, SMALL = 20, 1e-5


@dataclass(frozen=True)
class Swing:
    """One swing."""

    command_m_s: float
    speed_m_s: float
    """reached, of the tip"""
    speed_sd_m_s: float
    drop_m_s: float | None = None
    """what the touch took from the tip's speed; None: nothing stood out"""
    drop_sd_m_s: float = 0.0
    body_kg: float | None = None
    """what it met, free to move; None: air; infinite: a wall"""


@dataclass(frozen=True)
class SwingRatio:
    """Reached over commanded tip speed."""

    mean: float
    mean_sd: float
    scatter: float
    """1 sigma from swing to swing"""


@dataclass(frozen=True)
class StrikerNumbers:
    """Effective mass and restitution, 1 sigma each."""

    effective_mass_kg: float
    effective_mass_sd_kg: float
    restitution: float
    restitution_sd: float


def swing_ratio(swings: Sequence[Swing]) -> SwingRatio:
    """Mean over all swings, weighted by what each knows; its sd from the scatter or from the stated sd, whichever is larger."""
    ratio = np.array([each.speed_m_s / each.command_m_s for each in swings])
    sd = np.array([max(each.speed_sd_m_s / each.command_m_s, LEAST_SPEED_SD) for each in swings])
    weight = sd**-2 / np.sum(sd**-2)
    mean = float(weight @ ratio)
    scatter = math.sqrt(float(weight @ (ratio - mean) ** 2) * len(ratio) / max(len(ratio) - 1, 1))
    return SwingRatio(mean, max(scatter / math.sqrt(len(ratio)), math.sqrt(1 / float(np.sum(sd**-2)))), scatter)


def learn_striker(prior: StrikerNumbers, swings: Sequence[Swing]) -> StrikerNumbers:
    """The prior, changed by the swings that met a body; without one it comes back as it was.

    Unknown: ln m_s, ln(1 + e) and the common error of all drops; Gauss and Newton from the prior.
    """
    met = [each for each in swings if each.body_kg is not None and each.drop_m_s is not None and each.drop_m_s > 0]
    if not met:
        return prior
    log_share = np.array([math.log((each.drop_m_s or 0.0) / each.speed_m_s) for each in met])
    sd = np.array([math.hypot(each.drop_sd_m_s / (each.drop_m_s or 1.0), each.speed_sd_m_s / each.speed_m_s) for each in met])
    light = np.array([1 / (each.body_kg or math.inf) for each in met])
    sds = np.array(
        [
            max(prior.effective_mass_sd_kg, LEAST_MASS_SD) / prior.effective_mass_kg,
            max(prior.restitution_sd, LEAST_RESTITUTION_SD) / (1 + prior.restitution),
            DROP_SD,
        ]
    )
    middle = np.array([math.log(prior.effective_mass_kg), math.log1p(prior.restitution), 0.0])

    def residual(x: np.ndarray[tuple[int], np.dtype[np.float64]]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        told = x[1] + x[2] - np.log1p(np.exp(x[0]) * light)
        return np.concatenate([(told - log_share) / np.maximum(sd, LEAST_SPEED_SD), (x - middle) / sds])

    x = middle.copy()
    covariance = np.diag(sds**2)
    for _ in range(STEPS):
        now = residual(x)
        slope = np.stack([(residual(x + SMALL * unit) - now) / SMALL for unit in np.eye(3)], axis=-1)
        covariance = np.linalg.inv(slope.T @ slope)
        step = covariance @ (slope.T @ now)
        x = x - step
        if float(np.abs(step).max()) < 1e-6:
            break
    mass, bounce = math.exp(float(x[0])), math.exp(float(x[1]))
    mass_sd, bounce_sd = mass * math.sqrt(float(covariance[0, 0])), bounce * math.sqrt(float(covariance[1, 1]))
    return StrikerNumbers(mass, mass_sd, min(max(bounce - 1, 0.0), 1.0), bounce_sd)
