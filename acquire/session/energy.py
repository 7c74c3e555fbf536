"""How hard to strike next: learns striker and object together from every strike, and keeps the tip just over the top (METHOD.md 1.5).

A strike at tip speed v, height h gives the impulse J = (1 + e)*v / (1/m_s + h^2/I) and the energy ratio E = (J*h)^2 / (2*I*m*g*(R - z)),
I the moment about the edge, R the distance of c from it, z its height over it. Unknown, with the plan's hypothesis as prior: where c
is, the scale of the moments, the striker's effective mass m_s and restitution e, how much faster it swings than told, and per axis what
this model leaves out (the tip's friction, a slanting face). Every strike tells of all of them: the angle of balance of c, the energy of
everything. So an axis that was never struck is known from its neighbours. The most probable values are found by Gauss and Newton, their
covariance there gives the spread, and E's distribution for the next strike follows by draws.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import log_ndtr

from schemas.result import Verdict
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.watch_lines import StrikeVerdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

MODEL_SD = 0.08
"""of ln E, per axis: what the model leaves out (0.02 to 0.17 in the virtual rig)"""
READING_SD, SPOILT_SD = 0.03, 0.25
"""of ln E from strike to strike on one axis; where the contact was not clean"""
TAILS = 3.0
"""degrees of freedom of the readings' t distribution: a second touch of the arm, now and then, adds a third or a half"""
ANGLE_SD = math.radians(0.3)
"""rad, of a balance angle beside its own: gravity's tilt, the edge's place, the placement"""
TOP_SD = 0.08
"""of ln E as the highest angle of a tip that fell back tells it"""
BOUND_SD = 0.05
"""of ln E: how sharp "over" and "back" are"""
UNMOVED_ENERGY = 0.4
"""of what a strike that turned the object by less than half a degree can have been"""
SWING_SD, SPEED_SD = 0.02, 0.012
"""relative: reached over commanded tip speed, all strikes alike; one reading of it"""
SCALE_SD = 0.2
"""relative, of the moments about c all together"""
MASS_SD, RESTITUTION_SD = 0.25, 0.15
"""relative, and as such, where the plan does not say"""
DRAWS, SEED = 600, 20070601
REGION = 2.0
"""half edges of the hypothesis region in standard deviations"""
STEPS, BELIEVED, SMALL, SETTLED = 14, 4, 1e-4, 1e-3
SHORTENED = (1.0, 0.5, 0.25, 0.1)
LEAST_RISE = 1e-4
"""m by which c must rise to be over the top: less is a body that does not stand"""
_SPOILT = frozenset({Verdict.SLID, Verdict.ROLLED, Verdict.TWISTED, Verdict.AIRBORNE, Verdict.STRUCK_TWICE})


@dataclass(frozen=True)
class EnergyGoal:
    """What a strike shall have, and what it must not."""

    goal: float = 1.15
    """the median aimed at"""
    likely: float = 2.0
    """not exceeded with 95 %"""
    most: float = 2.7
    """not exceeded with 99.5 %"""


@dataclass(frozen=True)
class StrikerEstimate:
    """What the strikes so far say of the striker; 1 sigma each. Mass and restitution are hardly told apart by tips alone."""

    effective_mass_kg: float
    effective_mass_sd_kg: float
    restitution: float
    restitution_sd: float
    swing_ratio: float
    """reached over commanded tip speed"""
    swing_ratio_sd: float

    def text(self) -> str:
        """In words."""
        mass, mass_sd = 1000 * self.effective_mass_kg, 1000 * self.effective_mass_sd_kg
        reached, reached_sd = 100 * self.swing_ratio, 100 * self.swing_ratio_sd
        tip = f"restitution {self.restitution:.2f} ± {self.restitution_sd:.2f}, effective mass {mass:.0f} ± {mass_sd:.0f} g"
        return f"striker's {tip}, reaches {reached:.1f} ± {reached_sd:.1f} % of the speed asked for"


class _Kind(enum.Enum):
    """What a strike can tell."""

    SWING = "ln of reached over commanded tip speed"
    PHI = "the angle of balance"
    ENERGY = "ln E"
    BELOW = "ln E was less"
    ABOVE = "ln E was more"
    TOP = "the angle at which it turned back"


_READ = frozenset({_Kind.SWING, _Kind.PHI, _Kind.ENERGY, _Kind.TOP})


@dataclass(frozen=True)
class _Heard:
    """One thing a strike told."""

    axis: int
    kind: _Kind
    value: float
    sd: float
    log_speed: float
    """reached, of the tip"""

    def missed(self, swing: Array, log_energy: Array, phi: Array) -> Array:
        """By how many standard deviations states (k,) miss it; ln E given at 1 m/s."""
        log_energy = log_energy + 2 * self.log_speed
        match self.kind:
            case _Kind.SWING:
                return (swing - self.value) / self.sd
            case _Kind.PHI:
                return (phi - self.value) / self.sd
            case _Kind.ENERGY:
                return (log_energy - self.value) / self.sd
            case _Kind.TOP:
                phi = np.maximum(phi, self.value + 1e-3)
                reached = (np.cos(phi - self.value) - np.cos(phi)) / (1 - np.cos(phi))
                return (log_energy - np.log(reached)) / self.sd
            case _Kind.BELOW | _Kind.ABOVE:
                beyond = (log_energy - self.value) / self.sd
                return _excess(beyond if self.kind is _Kind.BELOW else -beyond)


class EnergyLearner:
    """One session's knowledge of striker and object.

    Args:
        plan: its strikes and, where it has one, its hypothesis; without it each axis has only its predicted angle's spread.
        goal: see EnergyGoal.
    """

    def __init__(self, plan: StrikePlan, goal: EnergyGoal | None = None) -> None:
        self._goal = goal or EnergyGoal()
        self._axes = {axis_id: i for i, axis_id in enumerate(dict.fromkeys(strike.axis_id for strike in plan.strikes))}
        first = {strike.axis_id: strike for strike in reversed(plan.strikes)}
        self._model = _Model(plan, [first[axis_id] for axis_id in self._axes])
        self._heard: list[_Heard] = []
        self._best = np.zeros(self._model.size)
        self._covariance = np.eye(self._model.size)
        self._draws = np.random.default_rng(SEED).standard_normal((DRAWS, self._model.size + 1))

    def tip_speed(self, strike: PlannedStrike) -> float:
        """Speed to command for the next strike on this axis [m/s], within the plan's limits."""
        log_energy = self._log_energy(strike)
        bounds = [(0.5, self._goal.goal), (0.95, self._goal.likely), (0.995, self._goal.most)]
        speed = math.exp(0.5 * min(math.log(limit) - float(np.quantile(log_energy, share)) for share, limit in bounds))
        return min(max(speed, strike.tip_speed_m_s.min), strike.tip_speed_m_s.max)

    def speed_for(self, strike: PlannedStrike, energy: float) -> float:
        """Tip speed [m/s] of which this E is expected (the median), whatever the plan's limits."""
        return math.exp(0.5 * (math.log(energy) - float(np.median(self._log_energy(strike)))))

    def energy(self, strike: PlannedStrike, tip_speed_m_s: float) -> tuple[float, float, float]:
        """Median of E expected of a commanded tip speed, and the bounds that hold 90 % of it."""
        low, middle, high = np.exp(np.quantile(self._log_energy(strike), [0.05, 0.5, 0.95]) + 2 * math.log(tip_speed_m_s))
        return float(middle), float(low), float(high)

    def learn(self, strike: PlannedStrike, command_m_s: float, speed_m_s: float | None, verdict: StrikeVerdict | None) -> None:
        """Take in what a strike gave.

        Args:
            strike: as planned.
            command_m_s: tip speed that was asked for.
            speed_m_s: as the striker measured it; None: it met nothing, or cannot tell.
            verdict: None: nobody looked.
        """
        axis = self._axes[strike.axis_id]
        log_speed = math.log(command_m_s) + float(self._model.swing(self._best[None])[0])
        if speed_m_s is not None and speed_m_s > 0:
            log_speed = math.log(speed_m_s)
            self._heard.append(_Heard(axis, _Kind.SWING, log_speed - math.log(command_m_s), SPEED_SD, 0.0))
        if verdict is not None:
            self._heard += _said(axis, log_speed, verdict)
        self._solve()

    @property
    def striker(self) -> StrikerEstimate:
        """The striker, by all strikes so far."""
        drawn = self._posterior()
        mass, rebound, swing = np.exp(self._model.striker(drawn)), np.exp(self._model.bounce(drawn)) - 1, np.exp(self._model.swing(drawn))
        spread = [(float(np.median(each)), float(np.std(each))) for each in (mass, rebound, swing)]
        return StrikerEstimate(*spread[0], *spread[1], *spread[2])

    def _log_energy(self, strike: PlannedStrike) -> Array:
        """(n,) draws of ln E at a commanded tip speed of 1 m/s."""
        drawn = self._posterior()
        log_energy = self._model.tip(drawn, self._axes[strike.axis_id])[0] + 2 * self._model.swing(drawn)
        return log_energy + READING_SD * self._draws[:, -1]

    def _posterior(self) -> Array:
        drawn = self._best + self._draws[:, :-1] @ np.linalg.cholesky(self._covariance).T
        # The hypothesis region ends at two standard deviations; what strikes say of c may lie beyond.
        near = self._best[:3]
        drawn[:, :3] = np.clip(drawn[:, :3], np.minimum(near, -REGION), np.maximum(near, REGION))
        return drawn

    def _solve(self) -> None:
        """Gauss and Newton with shortened steps, from the last best; outliers lose their weight only once all readings were believed.

        Else a body or striker far from what was told would make every reading an outlier, for ever.
        """
        z = self._best
        residual = self._residuals(z[None])[0]
        weight = np.ones_like(residual)
        for turn in range(STEPS):
            moved = z + SMALL * np.eye(len(z))
            slope = (self._residuals(moved) - residual).T / SMALL
            scaled = slope * weight[:, None]
            self._covariance = np.linalg.inv(scaled.T @ slope)
            step = self._covariance @ (scaled.T @ residual)
            cost = float(weight @ residual**2)
            before = z
            for part in SHORTENED:
                trial = self._residuals((z - part * step)[None])[0]
                if float(weight @ trial**2) <= cost:
                    z, residual = z - part * step, trial
                    break
            if turn >= BELIEVED and float(np.abs(z - before).max()) < SETTLED:
                break
            weight = self._weights(residual) if turn >= BELIEVED - 1 else weight
        self._best = z

    def _residuals(self, z: Array) -> Array:
        """(k, n): of what was heard, then of the prior, for states z (k, d)."""
        swing, tips = self._model.swing(z), {axis: self._model.tip(z, axis) for axis in {each.axis for each in self._heard}}
        heard = [each.missed(swing, *tips[each.axis]) for each in self._heard]
        return np.concatenate([np.stack(heard, axis=-1), z], axis=-1) if heard else z

    def _weights(self, residual: Array) -> Array:
        """(n,) of a t distribution for what was read off, 1 for bounds and prior."""
        read = [*(each.kind in _READ for each in self._heard), *([False] * self._model.size)]
        return np.where(read, (TAILS + 1) / (TAILS + residual**2), 1.0)


def _said(axis: int, log_speed: float, verdict: StrikeVerdict) -> list[_Heard]:
    """What a verdict tells; of some nothing (the marker was lost, the object lay wrong)."""
    code, energy = verdict.code, verdict.energy_ratio
    told: list[_Heard] = []
    if verdict.phi is not None and code in {Verdict.GOOD, Verdict.ROCKED_BACK}:
        told.append(_Heard(axis, _Kind.PHI, verdict.phi, math.hypot(ANGLE_SD, verdict.phi_sd or 0.0), log_speed))
    if energy is not None and energy > 0 and (code in _SPOILT or code in {Verdict.GOOD, Verdict.ROCKED_BACK}):
        told.append(_Heard(axis, _Kind.ENERGY, math.log(energy), SPOILT_SD if code in _SPOILT else READING_SD, log_speed))
    elif code is Verdict.ROCKED_BACK:
        top = verdict.theta_max_rad
        told.append(_Heard(axis, _Kind.BELOW, 0.0, BOUND_SD, log_speed))
        if top is not None and top > 0:
            told.append(_Heard(axis, _Kind.TOP, top, TOP_SD, log_speed))
    elif code is Verdict.GOOD:
        told.append(_Heard(axis, _Kind.ABOVE, 0.0, BOUND_SD, log_speed))
    elif code is Verdict.NOT_MOVED:
        told.append(_Heard(axis, _Kind.BELOW, math.log(UNMOVED_ENERGY), BOUND_SD, log_speed))
    return told


class _Model:
    """The physics as a function of z, whose prior is N(0, 1) in every entry: c (3), moments, m_s, 1 + e, swing, one per axis."""

    def __init__(self, plan: StrikePlan, strikes: list[PlannedStrike]) -> None:
        believed = plan.hypothesis
        self.size = 7 + len(strikes)
        self._known = believed is not None
        self._bounce_0, self._bounce_sd = math.log(1.4), RESTITUTION_SD / 1.4
        self._mass_0, self._mass_sd = math.log(0.2), MASS_SD
        self._com, self._root, self._weight, self._body = np.zeros(3), np.zeros((3, 3)), 0.0, 0.0
        if believed is not None:
            values, vectors = np.linalg.eigh(np.array(believed.com_covariance_m2))
            self._com, self._root = np.array(believed.com_m), vectors * np.sqrt(np.maximum(values, 0.0))
            self._body, self._weight = believed.mass_kg, believed.mass_kg * believed.g_m_s2
            tip = believed.striker
            self._bounce_0, self._bounce_sd = math.log1p(tip.restitution), tip.restitution_sd / (1 + tip.restitution)
            self._mass_0 = math.log(tip.effective_mass_kg)
            self._mass_sd = tip.effective_mass_sd_kg / tip.effective_mass_kg
        self._planned = [_Axis.of(strike, self._com, self._body) for strike in strikes]
        self._own_sd = [MODEL_SD if self._known else math.hypot(MODEL_SD, _spread(strike)) for strike in strikes]

    def striker(self, z: Array) -> Array:
        """The logarithm of m_s."""
        return self._mass_0 + self._mass_sd * z[:, 4]

    def bounce(self, z: Array) -> Array:
        """The logarithm of 1 + e."""
        return self._bounce_0 + self._bounce_sd * z[:, 5]

    def swing(self, z: Array) -> Array:
        """The logarithm of reached over commanded tip speed."""
        return SWING_SD * z[:, 6]

    def tip(self, z: Array, axis: int) -> tuple[Array, Array]:
        """(k,) ln E where the tip reaches 1 m/s, and phi [rad]; without a hypothesis phi is what it was predicted to be."""
        at = self._planned[axis]
        own = self._own_sd[axis] * z[:, 7 + axis]
        if not self._known:
            return own + at.log_energy + 2 * (self.bounce(z) - self._bounce_0), np.full(len(z), at.phi)
        arm = self._com + z[:, :3] @ self._root.T - at.point
        up, forward = arm @ at.up, -(arm @ at.tip)
        distance = np.hypot(up, forward)
        rise = np.maximum(distance - up, LEAST_RISE)
        moment = at.i_com * np.exp(SCALE_SD * z[:, 3]) + self._body * (distance + at.radius) ** 2
        impulse = self.bounce(z) - np.log(np.exp(-self.striker(z)) + at.height**2 / moment)
        return own + 2 * (impulse + math.log(at.height)) - np.log(2 * moment * self._weight * rise), np.arctan2(forward, up)


@dataclass(frozen=True)
class _Axis:
    """What the model needs of one axis, in O."""

    point: Array
    tip: Array
    up: Array
    radius: float
    height: float
    i_com: float
    """kg m^2, about the parallel axis through c"""
    phi: float
    log_energy: float
    """as planned, at 1 m/s"""

    @classmethod
    def of(cls, strike: PlannedStrike, com: Array, mass: float) -> _Axis:
        """From the plan, c at `com`."""
        tip, _, up = np.array(strike.R_world_object)
        point = np.array(strike.pivot.point)
        across = (com - point) @ np.stack([tip, up]).T
        i_com = strike.i_edge_predicted_kg_m2 - mass * (math.hypot(*across) + strike.pivot.radius_m) ** 2
        i_com = max(i_com, 0.1 * strike.i_edge_predicted_kg_m2)
        log_energy = math.log(strike.energy_ratio) - 2 * math.log(strike.tip_speed_m_s.target)
        return cls(point, tip, up, strike.pivot.radius_m, strike.impact_height_m, i_com, strike.phi_predicted_rad, log_energy)


def _spread(strike: PlannedStrike) -> float:
    """1 sigma of ln E by the spread of the predicted angle: the rise goes with 1 - cos phi."""
    return strike.phi_predicted_sd_rad / math.tan(max(strike.phi_predicted_rad, 0.02) / 2)


def _excess(beyond: Array) -> Array:
    """A bound that is passed by `beyond` sd, as a residual: sqrt(-2 ln(normal distribution at -beyond))."""
    return np.sqrt(-2 * log_ndtr(-beyond))
