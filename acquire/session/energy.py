"""Adaptive choice of the tip speed: striker and object are estimated from every strike.

A strike with tip speed v at height h gives the impulse J = (1 + e)*v / (1/m_s + h^2/I) and the energy ratio E
= (J*h)^2 / (2*I*m*g*(R - z)): kinetic energy over the energy needed to tip. m_s is the striker's effective
mass, e the restitution of tip and object, I the moment of inertia about the edge, m the object's mass, g
gravity, R the distance of the centre of mass c from the edge, z the height of c over it
(docs/explanation/method.md, section 1.5).

Unknown, with the plan's hypothesis (assumed centre of mass, mass and striker) as prior: the position of c, a
scale of the moments of inertia, m_s, e, the ratio of reached to commanded tip speed, and per axis (pivot
edge) a model error (friction at the tip, a slanting face). Every strike informs all of them: the balance
angle informs c, the energy informs everything. So the first strike on a new axis profits from the strikes on
the others. The mode of the posterior is found by Gauss-Newton, its covariance follows from the linearisation
there, and draws from that normal distribution give the distribution of E for the next strike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from acquire.session.energy_model import EnergyModel
from acquire.session.energy_observations import LOG_ENERGY_SD, Observation, Quantity, strike_observations
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.watch_lines import StrikeVerdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

T_DEGREES_OF_FREEDOM = 3.0
"""degrees of freedom of the measurements' t distribution; its tails are heavy because a second contact of the
arm sometimes adds a third or a half of the energy"""
TIP_SPEED_SD = 0.012
"""relative standard deviation of one measured tip speed"""
DRAW_COUNT, DRAW_SEED = 600, 20070601
"""number of draws from the posterior, and seed of their generator"""
REGION_HALF_EDGE_SDS = 2.0
"""half edge of the hypothesis region in standard deviations of c"""
MAX_ITERATIONS, UNWEIGHTED_ITERATIONS = 14, 4
DIFFERENCE_STEP, CONVERGED_STEP = 1e-4, 1e-3
STEP_FRACTIONS = (1.0, 0.5, 0.25, 0.1)
"""fractions of a Gauss-Newton step tried, until one does not increase the cost"""
ENERGY_LIMITS = ((0.5, 1.15), (0.95, 2.0), (0.995, 2.7))
"""limits of the next strike's energy ratio E: (probability, greatest value of that quantile of E); E is the
kinetic energy after the strike over the energy needed to reach balance"""
_MEASURED = frozenset({Quantity.LOG_SWING_RATIO, Quantity.PHI, Quantity.LOG_ENERGY, Quantity.TOP_ANGLE})
"""quantities that a strike measures; the others are bounds"""


@dataclass(frozen=True)
class StrikerEstimate:
    """Effective mass [kg], coefficient of restitution and swing ratio of the striker, each with its sd.

    They are estimated from the session's strikes so far. The swing ratio is reached over commanded tip
    speed. Strikes of the object alone hardly distinguish effective mass from restitution.
    """

    effective_mass_kg: float
    """effective mass at the striker's tip [kg]"""
    effective_mass_sd_kg: float
    restitution: float
    """coefficient of restitution of tip and object"""
    restitution_sd: float
    swing_ratio: float
    """reached over commanded tip speed"""
    swing_ratio_sd: float

    def text(self) -> str:
        """One line of text on the striker: restitution, effective mass, reached speed, each with its sd.

        The effective mass at the striker's tip is in g, the reached tip speed in % of the commanded one.
        """
        mass, mass_sd = 1000 * self.effective_mass_kg, 1000 * self.effective_mass_sd_kg
        reached, reached_sd = 100 * self.swing_ratio, 100 * self.swing_ratio_sd
        return (
            f"striker: restitution {self.restitution:.2f} ± {self.restitution_sd:.2f}, "
            f"effective mass {mass:.0f} ± {mass_sd:.0f} g, "
            f"reached speed {reached:.1f} ± {reached_sd:.1f} % of the commanded speed"
        )


class EnergyLearner:
    """Distribution of striker and object parameters, learned strike by strike; gives tip speeds.

    Args:
        plan: the planned strikes and, if the plan has one, its hypothesis (assumed centre of mass, mass and
            striker). Without a hypothesis the centre of mass is not learned: energies are scaled from those
            in the plan, with the uncertainty that follows from that of the predicted balance angles.
    """

    def __init__(self, plan: StrikePlan) -> None:
        self._axes = {
            axis_id: i for i, axis_id in enumerate(dict.fromkeys(each.axis_id for each in plan.strikes))
        }
        first = {strike.axis_id: strike for strike in reversed(plan.strikes)}
        self._model = EnergyModel(plan, [first[axis_id] for axis_id in self._axes])
        self._observations: list[Observation] = []
        self._mode = np.zeros(self._model.size)
        self._covariance = np.eye(self._model.size)
        self._draws = np.random.default_rng(DRAW_SEED).standard_normal((DRAW_COUNT, self._model.size + 1))

    def tip_speed(self, strike: PlannedStrike) -> float:
        """Speed of the striker's tip [m/s] to command for the next strike on the pivot edge of `strike`.

        E is the energy ratio, kinetic energy after the strike over the energy needed to reach balance. The
        speed is the largest at which three quantiles of E keep their limits (ENERGY_LIMITS: median 1.15,
        95 % quantile 2.0, 99.5 % quantile 2.7), clipped to the plan's speed limits for this strike.
        """
        log_energy = self._log_energy_draws(strike)
        margins = [math.log(limit) - float(np.quantile(log_energy, q)) for q, limit in ENERGY_LIMITS]
        speed = math.exp(0.5 * min(margins))
        return min(max(speed, strike.aim.tip_speed_m_s.min), strike.aim.tip_speed_m_s.max)

    def speed_for(self, strike: PlannedStrike, energy: float) -> float:
        """Speed of the striker's tip [m/s] to command for a median energy ratio E of `energy`.

        E is the kinetic energy after the strike over the energy needed to reach balance. The plan's limits of
        the tip speed are not applied.

        Args:
            strike: the planned strike.
            energy: wanted median of E.
        """
        return math.exp(0.5 * (math.log(energy) - float(np.median(self._log_energy_draws(strike)))))

    def energy(self, strike: PlannedStrike, tip_speed_m_s: float) -> tuple[float, float, float]:
        """Median and 90 % interval of the energy ratio E of a planned strike at a commanded tip speed [m/s].

        E is the kinetic energy after the strike over the energy needed to reach balance.

        Returns:
            The median, then the lower and upper end of the interval.
        """
        quantiles = np.quantile(self._log_energy_draws(strike), [0.05, 0.5, 0.95])
        low, middle, high = np.exp(quantiles + 2 * math.log(tip_speed_m_s))
        return float(middle), float(low), float(high)

    def learn(
        self,
        strike: PlannedStrike,
        command_m_s: float,
        speed_m_s: float | None,
        verdict: StrikeVerdict | None,
    ) -> None:
        """Update the distribution of the striker's and object's parameters with one strike.

        Args:
            strike: the planned strike; its axis (pivot edge) must be one of the plan's.
            command_m_s: commanded tip speed [m/s].
            speed_m_s: tip speed measured by the striker [m/s]; None if the arm met nothing or the speed is
                unknown. The reached speed is then the expected one.
            verdict: answer of `analyze watch`, which judges the strike from its images; None if there is
                none.
        """
        axis = self._axes[strike.axis_id]
        log_speed = math.log(command_m_s) + float(self._model.log_swing_ratio(self._mode[None])[0])
        if speed_m_s is not None and speed_m_s > 0:
            log_speed = math.log(speed_m_s)
            log_ratio = log_speed - math.log(command_m_s)
            self._observations.append(
                Observation(axis, Quantity.LOG_SWING_RATIO, log_ratio, TIP_SPEED_SD, 0.0)
            )
        if verdict is not None:
            self._observations += strike_observations(axis, log_speed, verdict)
        self._solve()

    @property
    def striker(self) -> StrikerEstimate:
        """Effective mass [kg], restitution and swing ratio of the striker, each with standard deviation.

        Restitution is that of tip and object; the swing ratio is reached over commanded tip speed. Each value
        is the median of the posterior after all strikes so far.
        """
        states = self._posterior_draws()
        mass = np.exp(self._model.log_striker_mass(states))
        restitution = np.exp(self._model.log_rebound(states)) - 1
        swing_ratio = np.exp(self._model.log_swing_ratio(states))
        values = [(float(np.median(each)), float(np.std(each))) for each in (mass, restitution, swing_ratio)]
        return StrikerEstimate(*values[0], *values[1], *values[2])

    def _log_energy_draws(self, strike: PlannedStrike) -> Array:
        """Draws (DRAW_COUNT,) of ln E, E the energy ratio of the next strike on the pivot edge of `strike`.

        E is the kinetic energy after the strike over the energy needed to reach balance. The commanded tip
        speed is 1 m/s; the scatter between strikes is included.
        """
        states = self._posterior_draws()
        log_energy, _ = self._model.log_energy_and_phi(states, self._axes[strike.axis_id])
        return log_energy + 2 * self._model.log_swing_ratio(states) + LOG_ENERGY_SD * self._draws[:, -1]

    def _posterior_draws(self) -> Array:
        """Draws (DRAW_COUNT, d) of the d unknowns of striker and object from their posterior.

        Each unknown has the prior N(0, 1). The first three, which stand for the position of the centre of
        mass, are clipped to REGION_HALF_EDGE_SDS on either side of 0, or to the posterior's mode where the
        mode is farther from 0.
        """
        states = self._mode + self._draws[:, :-1] @ np.linalg.cholesky(self._covariance).T
        # The hypothesis region ends at two standard deviations, but the estimate of c may lie outside.
        com = self._mode[:3]
        limit = REGION_HALF_EDGE_SDS
        states[:, :3] = np.clip(states[:, :3], np.minimum(com, -limit), np.maximum(com, limit))
        return states

    def _solve(self) -> None:
        """Fit the model of striker and object to all observations: set its posterior's mode and covariance.

        Damped Gauss-Newton steps start from the last mode. The first iterations weight all measurements
        fully: otherwise an object or striker far from the prior (the plan's assumption) would make every
        measurement an outlier and could never be learned.
        """
        z = self._mode
        residual = self._residuals(z[None])[0]
        weight = np.ones_like(residual)
        for iteration in range(MAX_ITERATIONS):
            moved = z + DIFFERENCE_STEP * np.eye(len(z))
            jacobian = (self._residuals(moved) - residual).T / DIFFERENCE_STEP
            scaled = jacobian * weight[:, None]
            self._covariance = np.linalg.inv(scaled.T @ jacobian)
            step = self._covariance @ (scaled.T @ residual)
            cost = float(weight @ residual**2)
            before = z
            for fraction in STEP_FRACTIONS:
                trial = self._residuals((z - fraction * step)[None])[0]
                if float(weight @ trial**2) <= cost:
                    z, residual = z - fraction * step, trial
                    break
            if iteration >= UNWEIGHTED_ITERATIONS and float(np.abs(z - before).max()) < CONVERGED_STEP:
                break
            weight = self._weights(residual) if iteration >= UNWEIGHTED_ITERATIONS - 1 else weight
        self._mode = z

    def _residuals(self, z: Array) -> Array:
        """Residuals (k, n), in standard deviations, for k states z (k, d) of the model.

        A state is the vector of the d unknowns of striker and object. The residuals are those of the n - d
        observations, then of the prior: N(0, 1) for each unknown, so that its residuals are z itself.
        """
        if not self._observations:
            return z
        log_swing_ratio = self._model.log_swing_ratio(z)
        axes = {each.axis for each in self._observations}
        predicted = {axis: self._model.log_energy_and_phi(z, axis) for axis in axes}
        residuals = [each.residual(log_swing_ratio, *predicted[each.axis]) for each in self._observations]
        return np.concatenate([np.stack(residuals, axis=-1), z], axis=-1)

    def _weights(self, residual: Array) -> Array:
        """Weights (n,) with which the squares of n residuals [standard deviations] enter the cost.

        Those of measurements are the weights of a t distribution, smaller for larger residuals; those of
        bounds and of the prior are 1.
        """
        measured = [
            *(each.quantity in _MEASURED for each in self._observations),
            *([False] * self._model.size),
        ]
        dof = T_DEGREES_OF_FREEDOM
        return np.where(measured, (dof + 1) / (dof + residual**2), 1.0)
