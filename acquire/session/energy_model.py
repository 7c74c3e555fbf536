"""Model of energy ratio and balance angle as a function of striker and object parameters.

The energy ratio E is the kinetic energy after a strike over the energy needed to reach balance; the balance
angle phi is the tipping angle at which the centre of mass c stands above the pivot edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from schemas.impact_law import inverse_impact_mass
from schemas.strike_plan import PlannedStrike, StrikePlan

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

LOG_ENERGY_MODEL_SD = 0.08
"""standard deviation of the model error of ln E, one per axis (0.02 to 0.17 in the virtual rig)"""
SWING_RATIO_SD = 0.02
"""relative prior standard deviation of reached over commanded tip speed, common to all strikes"""
INERTIA_SCALE_SD = 0.2
"""relative prior standard deviation of the common scale of the moments of inertia about c"""
STRIKER_MASS_KG, STRIKER_MASS_REL_SD = 0.2, 0.25
RESTITUTION, RESTITUTION_SD = 0.4, 0.15
"""prior of the striker where the plan has no hypothesis"""
MIN_RISE_M = 1e-4
"""smallest rise of c up to the balance point [m]; a body with less does not stand"""


class EnergyModel:
    """Model of one session's strikes as a function of a state z, whose prior is N(0, 1) in every entry.

    z has d entries, each a deviation from its expected value in prior standard deviations: position of the
    centre of mass c (3), scale of the moments of inertia, effective striker mass m_s, 1 + e with restitution
    e, swing ratio (reached over commanded tip speed), and one model error of ln E per pivot axis, with E the
    energy ratio (kinetic energy after the strike over that needed to reach balance). `size` is d.

    Args:
        plan: the strike plan; its hypothesis (assumed centre of mass, mass and striker), if it has one, gives
            the priors.
        strikes: one planned strike for each pivot axis.
    """

    def __init__(self, plan: StrikePlan, strikes: list[PlannedStrike]) -> None:
        hypothesis = plan.hypothesis
        self.size = 7 + len(strikes)
        self._known = hypothesis is not None
        self._log_rebound, self._log_rebound_sd = (
            math.log(1 + RESTITUTION),
            RESTITUTION_SD / (1 + RESTITUTION),
        )
        self._log_mass, self._log_mass_sd = math.log(STRIKER_MASS_KG), STRIKER_MASS_REL_SD
        self._com, self._com_root, self._weight, self._mass = np.zeros(3), np.zeros((3, 3)), 0.0, 0.0
        if hypothesis is not None:
            values, vectors = np.linalg.eigh(np.array(hypothesis.com_covariance_m2))
            self._com, self._com_root = np.array(hypothesis.com_m), vectors * np.sqrt(np.maximum(values, 0.0))
            self._mass, self._weight = hypothesis.mass_kg, hypothesis.mass_kg * hypothesis.g_m_s2
            tip = hypothesis.striker
            self._log_rebound, self._log_rebound_sd = (
                math.log1p(tip.restitution),
                tip.restitution_sd / (1 + tip.restitution),
            )
            self._log_mass = math.log(tip.effective_mass_kg)
            self._log_mass_sd = tip.effective_mass_sd_kg / tip.effective_mass_kg
        self._axes = [_Axis.from_plan(strike, self._com, self._mass) for strike in strikes]
        self._axis_sd = [
            LOG_ENERGY_MODEL_SD
            if self._known
            else math.hypot(LOG_ENERGY_MODEL_SD, _log_energy_spread(strike))
            for strike in strikes
        ]

    def log_striker_mass(self, z: Array) -> Array:
        """Logarithm ln m_s (k,) of the striker's effective mass m_s [kg], for k model states z (k, d).

        A state is the vector of the model's unknowns in prior standard deviations.
        """
        return self._log_mass + self._log_mass_sd * z[:, 4]

    def log_rebound(self, z: Array) -> Array:
        """Logarithm ln (1 + e) (k,), e the restitution of tip and object, for k model states z (k, d).

        A state is the vector of the model's unknowns in prior standard deviations.
        """
        return self._log_rebound + self._log_rebound_sd * z[:, 5]

    def log_swing_ratio(self, z: Array) -> Array:
        """Logarithm (k,) of reached over commanded tip speed, for k model states z (k, d).

        A state is the vector of the model's unknowns in prior standard deviations.
        """
        return SWING_RATIO_SD * z[:, 6]

    def log_energy_and_phi(self, z: Array, axis: int) -> tuple[Array, Array]:
        """Logarithm ln E of the energy ratio and balance angle phi [rad] of strikes on one pivot axis.

        E is the kinetic energy after a strike over the energy needed to reach balance.

        Args:
            z: (k, d) k states of the model, each with d entries of prior N(0, 1).
            axis: number of the pivot axis.

        Returns:
            ln E (k,) at a reached tip speed of 1 m/s, and phi (k,). If the plan states no hypothesis on
            centre of mass and inertia, phi is the plan's prediction for every state.
        """
        at = self._axes[axis]
        model_error = self._axis_sd[axis] * z[:, 7 + axis]
        if not self._known:
            rebound = self.log_rebound(z) - self._log_rebound
            return model_error + at.log_energy + 2 * rebound, np.full(len(z), at.phi)
        arm = self._com + z[:, :3] @ self._com_root.T - at.point
        up, forward = arm @ at.up, -(arm @ at.tip)
        distance = np.hypot(up, forward)
        rise = np.maximum(distance - up, MIN_RISE_M)
        i_edge = at.i_com * np.exp(INERTIA_SCALE_SD * z[:, 3]) + self._mass * (distance + at.radius) ** 2
        inverse_mass = inverse_impact_mass(np.exp(-self.log_striker_mass(z)), at.height, i_edge)
        log_impulse = self.log_rebound(z) - np.log(inverse_mass)
        log_energy = (
            model_error + 2 * (log_impulse + math.log(at.height)) - np.log(2 * i_edge * self._weight * rise)
        )
        return log_energy, np.arctan2(forward, up)


@dataclass(frozen=True)
class _Axis:
    """One pivot axis (edge about which the object tips): geometry in the object frame O, and its tip.

    Of the tip it holds the moment of inertia about the parallel axis through the centre of mass, the
    predicted balance angle, and the logarithm of the planned energy ratio (kinetic energy after the strike
    over the energy needed to reach balance), scaled to a tip speed of 1 m/s.
    """

    point: Array
    """(3,) point on the axis [m]"""
    tip: Array
    """(3,) unit vector in the direction of the strike, horizontal at rest"""
    up: Array
    """(3,) unit vector that points up when the object is at rest"""
    radius: float
    """radius of the edge's rounding [m]"""
    height: float
    """height of the impact point over the table [m]"""
    i_com: float
    """moment of inertia about the parallel axis through the centre of mass c [kg m^2]"""
    phi: float
    """predicted balance angle [rad]"""
    log_energy: float
    """planned ln E of the energy ratio E, scaled to a tip speed of 1 m/s"""

    @classmethod
    def from_plan(cls, strike: PlannedStrike, com: Array, mass: float) -> _Axis:
        """Pivot axis of a planned strike for a centre of mass (3,) [m, in O] and a mass [kg].

        O is the object's frame. The moment of inertia about the centre of mass is I - m (R + radius)^2, but
        at least I / 10. I is the predicted moment about the edge, m the mass, R the distance of the centre of
        mass from the axis, radius that of the edge's rounding [m].
        """
        tip, _, up = np.array(strike.R_world_object)
        point = np.array(strike.pivot.point)
        across = (com - point) @ np.stack([tip, up]).T
        i_com = strike.i_edge_predicted_kg_m2 - mass * (math.hypot(*across) + strike.pivot.radius_m) ** 2
        i_com = max(i_com, 0.1 * strike.i_edge_predicted_kg_m2)
        log_energy = math.log(strike.aim.energy_ratio) - 2 * math.log(strike.aim.tip_speed_m_s.target)
        radius, height = strike.pivot.radius_m, strike.aim.impact_height_m
        return cls(point, tip, up, radius, height, i_com, strike.phi_predicted_rad, log_energy)


def _log_energy_spread(strike: PlannedStrike) -> float:
    """Standard deviation of ln E, caused by that of the strike's predicted balance angle phi.

    E is the energy ratio, kinetic energy after the strike over the energy needed to reach balance. The energy
    needed is proportional to the rise of the centre of mass, and this to 1 - cos phi.
    """
    return strike.phi_predicted_sd_rad / math.tan(max(strike.phi_predicted_rad, 0.02) / 2)
