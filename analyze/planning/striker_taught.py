"""What strikes that were made say of the striker: the next plan's speeds start from there (METHOD 1.5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.planning.impact import StrikerModel
from analyze.types import Array

READING_SD = 0.02
"""of ln of the angular momentum, from strike to strike: the energy read off the motion, the speed by the striker"""
AXIS_SD = 0.04
"""the same, of all strikes on one axis: what the model of the touch leaves out (the tip's friction, a slanting face)"""
TAILS = 3.0
"""degrees of freedom of the readings' t distribution: a second touch of the arm, now and then"""
STEPS = 30
LEAST_MASS_SD, LEAST_RESTITUTION_SD = 1e-4, 1e-3


@dataclass(frozen=True)
class Touch:
    """One strike: what the striker gave, and what the object had of it."""

    axis_id: str
    tip_speed: float
    """m/s, just before contact, as the striker measured it"""
    height: float
    """m over the table"""
    i_edge: float
    """kg m^2"""
    phi: float
    """rad"""
    k: float
    """rad/s^2"""
    energy_ratio: float
    """E, at release"""

    @property
    def momentum(self) -> float:
        """I_edge*omega0 [kg m^2/s], with 1/2*omega0^2 = k*(1 - cos phi)*E."""
        return self.i_edge * float(np.sqrt(2 * self.k * (1 - np.cos(self.phi)) * self.energy_ratio))


def taught(striker: StrikerModel, touches: Sequence[Touch]) -> StrikerModel:
    """The striker by what was believed of it and the strikes made; 1 sigma each, as if independent.

    J*h = I_edge*omega0 with J = (1 + e)*v / (1/m_s + h^2/I_edge). Tips alone hardly tell e and m_s apart: each keeps the part of its
    spread that the other could make up for.

    Args:
        striker: as believed before.
        touches: of strikes that gave an energy; with none the striker is as before.
    """
    if not touches:
        return striker
    axes = sorted({touch.axis_id for touch in touches})
    mass_sd, bounce_sd = striker.effective_mass_sd_kg / striker.effective_mass_kg, striker.restitution_sd / (1 + striker.restitution)
    told = np.log([touch.momentum for touch in touches])
    given = np.log([touch.tip_speed * touch.height for touch in touches])
    yields = np.array([touch.height**2 / touch.i_edge for touch in touches])
    slope = np.zeros((len(touches), 2 + len(axes)))
    slope[:, 1] = bounce_sd
    slope[np.arange(len(touches)), [2 + axes.index(touch.axis_id) for touch in touches]] = AXIS_SD
    z = np.zeros(2 + len(axes))
    weight, covariance = np.ones(len(touches)), np.eye(len(z))
    for _ in range(STEPS):
        stiff = np.exp(-mass_sd * z[0]) / striker.effective_mass_kg
        expected = np.log1p(striker.restitution) + given - np.log(stiff + yields) + slope[:, 1:] @ z[1:]
        slope[:, 0] = mass_sd * stiff / (stiff + yields)
        residual = (told - expected) / READING_SD
        rows = slope / READING_SD
        covariance = np.linalg.inv(np.eye(len(z)) + rows.T @ (rows * weight[:, None]))
        z = z + covariance @ (rows.T @ (weight * residual) - z)
        weight = (TAILS + 1) / (TAILS + residual**2)
    return _striker(striker, z, np.sqrt(np.diag(covariance)), mass_sd, bounce_sd)


def _striker(before: StrikerModel, z: Array, sd: Array, mass_sd: float, bounce_sd: float) -> StrikerModel:
    mass = before.effective_mass_kg * float(np.exp(mass_sd * z[0]))
    rebound = (1 + before.restitution) * float(np.exp(bounce_sd * z[1]))
    return replace(
        before,
        effective_mass_kg=mass,
        effective_mass_sd_kg=max(mass * mass_sd * float(sd[0]), LEAST_MASS_SD),
        restitution=float(np.clip(rebound - 1, 0.0, 1.0)),
        restitution_sd=max(rebound * bounce_sd * float(sd[1]), LEAST_RESTITUTION_SD),
    )
