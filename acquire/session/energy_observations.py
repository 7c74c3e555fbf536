"""Observations from which `energy.py` learns: measured values and bounds that one strike gives.

The energy ratio E is the kinetic energy after a strike over the energy needed to reach balance.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import log_ndtr

from schemas.strike_result import Verdict
from schemas.watch_lines import StrikeVerdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

LOG_ENERGY_SD = 0.03
"""standard deviation of ln E, E the energy ratio, between strikes on one axis"""
LOG_ENERGY_SD_DISTURBED = 0.25
"""standard deviation of ln E for strikes with a disturbed contact (verdicts of `_DISTURBED`)"""
PHI_EXTRA_SD_RAD = math.radians(0.3)
"""standard deviation [rad] added in quadrature to that of a balance angle: gravity's tilt, the edge's
position, the placement"""
LOG_ENERGY_SD_FROM_TOP = 0.08
"""standard deviation of ln E derived from the largest angle of a tip that fell back"""
BOUND_SD = 0.05
"""standard deviation of the bounds on ln E from strikes that tipped over or fell back"""
MAX_ENERGY_UNMOVED = 0.4
"""largest energy ratio of a strike that turned the object by less than half a degree"""
_DISTURBED = frozenset(
    {Verdict.SLID, Verdict.ROLLED, Verdict.TWISTED, Verdict.AIRBORNE, Verdict.STRUCK_TWICE}
)
"""verdicts on strikes whose energy ratio is known, but only roughly"""


class Quantity(enum.Enum):
    """Kind of number that a strike measures, or to which it gives a bound.

    E is the energy ratio, kinetic energy after the strike over the energy needed to reach balance.
    """

    LOG_SWING_RATIO = "ln of reached over commanded tip speed"
    PHI = "balance angle"
    LOG_ENERGY = "ln E"
    LOG_ENERGY_BELOW = "upper bound of ln E"
    LOG_ENERGY_ABOVE = "lower bound of ln E"
    TOP_ANGLE = "largest angle of a tip that fell back"


@dataclass(frozen=True)
class Observation:
    """One number that a strike measured, or one bound that it gave, with its standard deviation.

    It belongs to one pivot axis and one reached tip speed. Angles are in rad. Tip speeds (of the striker) and
    energy ratios (kinetic energy after the strike over that needed to reach balance) are natural logarithms.
    """

    axis: int
    """number of the pivot axis in the model"""
    quantity: Quantity
    value: float
    """measured value or bound"""
    sd: float
    """standard deviation of `value`, in its unit"""
    log_speed: float
    """ln of the reached tip speed in m/s"""

    def residual(self, log_swing_ratio: Array, log_energy: Array, phi: Array) -> Array:
        """Residual (k,) of this observation for k states of the energy model, in standard deviations.

        For a measurement it is predicted less measured value. For a bound it is near 0 if the predicted value
        keeps the bound, and grows with the excess if not.

        Args:
            log_swing_ratio: (k,) predicted ln of reached over commanded tip speed.
            log_energy: (k,) predicted ln E at a tip speed of 1 m/s; E is the energy ratio, kinetic energy
                after the strike over that needed to reach balance.
            phi: (k,) predicted balance angle [rad].
        """
        log_energy = log_energy + 2 * self.log_speed
        match self.quantity:
            case Quantity.LOG_SWING_RATIO:
                predicted = log_swing_ratio
            case Quantity.PHI:
                predicted = phi
            case Quantity.LOG_ENERGY:
                predicted = log_energy
            case Quantity.TOP_ANGLE:
                phi = np.maximum(phi, self.value + 1e-3)
                reached = (np.cos(phi - self.value) - np.cos(phi)) / (1 - np.cos(phi))
                return (log_energy - np.log(reached)) / self.sd
            case Quantity.LOG_ENERGY_BELOW | Quantity.LOG_ENERGY_ABOVE:
                excess = (log_energy - self.value) / self.sd
                return _bound_residual(excess if self.quantity is Quantity.LOG_ENERGY_BELOW else -excess)
        return (predicted - self.value) / self.sd


def strike_observations(axis: int, log_speed: float, verdict: StrikeVerdict) -> list[Observation]:
    """Observations of the balance angle phi and of the energy ratio E from one verdict on a strike.

    E is the kinetic energy after the strike over the energy needed to reach balance.

    Args:
        axis: number of the pivot axis in the model.
        log_speed: ln of the reached tip speed in m/s.
        verdict: answer of `analyze watch`, which judges the strike from its images.

    Returns:
        After a strike that tipped the object, phi and ln E as far as measured; if E was not, a bound on ln E
        (above 0 if the object tipped over, below if it fell back) and the largest angle of an object that
        fell back. After a strike that did not move the object, an upper bound on ln E; after a disturbed one
        ln E alone, with a larger sd. An empty list after any other verdict, such as a lost marker.
    """
    code = verdict.code
    if code is Verdict.NOT_MOVED:
        return [
            Observation(axis, Quantity.LOG_ENERGY_BELOW, math.log(MAX_ENERGY_UNMOVED), BOUND_SD, log_speed)
        ]
    if code in _DISTURBED:
        return _energy_observation(axis, log_speed, verdict, LOG_ENERGY_SD_DISTURBED)
    if code not in {Verdict.GOOD, Verdict.ROCKED_BACK}:
        return []
    found: list[Observation] = []
    if verdict.phi is not None:
        phi_sd = math.hypot(PHI_EXTRA_SD_RAD, verdict.phi_sd or 0.0)
        found.append(Observation(axis, Quantity.PHI, verdict.phi, phi_sd, log_speed))
    energy = _energy_observation(axis, log_speed, verdict, LOG_ENERGY_SD)
    return found + (energy or _energy_bounds(axis, log_speed, verdict))


def _energy_observation(axis: int, log_speed: float, verdict: StrikeVerdict, sd: float) -> list[Observation]:
    energy = verdict.energy_ratio
    if energy is None or energy <= 0:
        return []
    return [Observation(axis, Quantity.LOG_ENERGY, math.log(energy), sd, log_speed)]


def _energy_bounds(axis: int, log_speed: float, verdict: StrikeVerdict) -> list[Observation]:
    """Bounds on ln E from whether a strike tipped the object over, if its energy ratio E was not measured.

    E is the kinetic energy after the strike over the energy needed to reach balance.

    Args:
        axis: number of the pivot axis in the model.
        log_speed: ln of the reached tip speed in m/s.
        verdict: answer of `analyze watch`: good (the object tipped over) or rocked back (it fell back).

    Returns:
        If the object tipped over, the observation that ln E is above 0. If it fell back, that ln E is below
        0, and its largest tipping angle [rad] if that is known.
    """
    if verdict.code is Verdict.GOOD:
        return [Observation(axis, Quantity.LOG_ENERGY_ABOVE, 0.0, BOUND_SD, log_speed)]
    found = [Observation(axis, Quantity.LOG_ENERGY_BELOW, 0.0, BOUND_SD, log_speed)]
    top = verdict.theta_max_rad
    if top is not None and top > 0:
        found.append(Observation(axis, Quantity.TOP_ANGLE, top, LOG_ENERGY_SD_FROM_TOP, log_speed))
    return found


def _bound_residual(excess: Array) -> Array:
    """Residual of a soft bound that is exceeded by `excess` standard deviations: sqrt(-2 ln Phi(-excess)).

    Phi is the normal distribution function; a negative `excess` keeps the bound and gives a residual near 0.
    """
    return np.sqrt(-2 * log_ndtr(-excess))
