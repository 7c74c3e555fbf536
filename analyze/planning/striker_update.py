"""Effective mass and restitution of the striker, estimated from strikes made (method 1.5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.planning.impact import StrikerModel
from analyze.types import Array
from schemas.impact_law import inverse_impact_mass

STRIKE_SD = 0.02
"""1 sigma of ln(angular momentum) from strike to strike: errors of the fitted energy and of the striker's
speed."""
AXIS_SD = 0.04
"""1 sigma of ln(angular momentum) common to one axis: unmodelled effects (the tip's friction, a slanting
face)."""
T_FREEDOM = 3.0
"""Degrees of freedom of the t distribution of the strikes' errors: the arm sometimes touches twice."""
FIT_ITERATIONS = 30
"""Iterations of the robust fit."""
MIN_MASS_SD, MIN_RESTITUTION_SD = 1e-4, 1e-3
"""Smallest standard deviations reported: of the effective mass [kg] and of the restitution."""


@dataclass(frozen=True)
class Touch:
    """One strike made: tip speed and impact height of the striker, and the fitted motion of the object.

    The motion's rate constant is k = m g R / I_edge: m the mass, g gravity, R the distance of the centre of
    mass from the edge's centre line, I_edge the moment of inertia about the edge.
    """

    axis_id: str
    """Id of the pivot axis struck."""
    tip_speed: float
    """Tip speed just before contact, as measured by the striker [m/s]."""
    height: float
    """Impact height over the table [m]."""
    i_edge: float
    """Moment of inertia about the edge [kg m^2]."""
    phi: float
    """Balance angle [rad]."""
    k: float
    """k = m g R / I_edge [rad/s^2]."""
    energy_ratio: float
    """Energy ratio E after the strike: energy over that needed to reach balance."""

    @property
    def momentum(self) -> float:
        """Angular momentum [kg m^2/s] of the object about the pivot edge right after the strike.

        It is I_edge omega0, with I_edge the moment of inertia about the edge and omega0 the angular rate,
        which follows from omega0^2 / 2 = k (1 - cos phi) E: phi is the balance angle, E the kinetic energy
        over that needed to reach balance, and k = m g R / I_edge [rad/s^2].
        """
        return self.i_edge * float(np.sqrt(2 * self.k * (1 - np.cos(self.phi)) * self.energy_ratio))


def updated_striker(striker: StrikerModel, touches: Sequence[Touch]) -> StrikerModel:
    """Striker updated by strikes made: effective mass m_s [kg] and restitution e, with their 1 sigma.

    The impulse J = (1 + e) v / (1/m_s + h^2/I_edge) at height h and tip speed v gives the angular momentum J
    h = I_edge omega0, with I_edge the moment of inertia about the edge and omega0 the angular rate after the
    strike. Tips alone hardly separate e and m_s: the 1 sigma of each includes the uncertainty of the other;
    their correlation is not reported.

    Args:
        striker: Striker as believed before.
        touches: Strikes with a fitted energy; without any the result is `striker` itself.
    """
    if not touches:
        return striker
    axes = sorted({touch.axis_id for touch in touches})
    mass_sd = striker.effective_mass_sd_kg / striker.effective_mass_kg
    bounce_sd = striker.restitution_sd / (1 + striker.restitution)
    measured = np.log([touch.momentum for touch in touches])
    given = np.log([touch.tip_speed * touch.height for touch in touches])
    heights = np.array([touch.height for touch in touches])
    i_edges = np.array([touch.i_edge for touch in touches])
    slope = np.zeros((len(touches), 2 + len(axes)))
    slope[:, 1] = bounce_sd
    slope[np.arange(len(touches)), [2 + axes.index(touch.axis_id) for touch in touches]] = AXIS_SD
    z = np.zeros(2 + len(axes))
    weight, covariance = np.ones(len(touches)), np.eye(len(z))
    for _ in range(FIT_ITERATIONS):
        stiff = np.exp(-mass_sd * z[0]) / striker.effective_mass_kg
        inverse_mass = inverse_impact_mass(stiff, heights, i_edges)
        expected = np.log1p(striker.restitution) + given - np.log(inverse_mass) + slope[:, 1:] @ z[1:]
        slope[:, 0] = mass_sd * stiff / inverse_mass
        residual = (measured - expected) / STRIKE_SD
        rows = slope / STRIKE_SD
        covariance = np.linalg.inv(np.eye(len(z)) + rows.T @ (rows * weight[:, None]))
        z = z + covariance @ (rows.T @ (weight * residual) - z)
        weight = (T_FREEDOM + 1) / (T_FREEDOM + residual**2)
    return _striker(striker, z, np.sqrt(np.diag(covariance)), mass_sd, bounce_sd)


def _striker(before: StrikerModel, z: Array, sd: Array, mass_sd: float, bounce_sd: float) -> StrikerModel:
    """Striker with fitted effective mass and restitution (cut to 0 to 1), and their 1 sigma.

    Args:
        before: Striker as believed before the fit.
        z: Fitted changes of ln(mass) and ln(1 + restitution), in units of their prior 1 sigma; further
            entries are ignored.
        sd: 1 sigma of the entries of `z`.
        mass_sd: Prior 1 sigma of ln(mass).
        bounce_sd: Prior 1 sigma of ln(1 + restitution).
    """
    mass = before.effective_mass_kg * float(np.exp(mass_sd * z[0]))
    rebound = (1 + before.restitution) * float(np.exp(bounce_sd * z[1]))
    return replace(
        before,
        effective_mass_kg=mass,
        effective_mass_sd_kg=max(mass * mass_sd * float(sd[0]), MIN_MASS_SD),
        restitution=float(np.clip(rebound - 1, 0.0, 1.0)),
        restitution_sd=max(rebound * bounce_sd * float(sd[1]), MIN_RESTITUTION_SD),
    )
