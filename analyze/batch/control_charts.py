"""Control charts of one quantity over sessions: individuals chart, and EWMA chart for slow drift.

Phase I: the first sessions give centre and limits (the baseline). Phase II: every later session is compared
with them. Sources:

- individuals chart: W. A. Shewhart (1931); limits from the mean moving range, divided by d2 = 1.128, by
  D. J. Wheeler and D. S. Chambers (1992, Understanding Statistical Process Control, ch. 9);
- EWMA: S. W. Roberts (1959, Technometrics 1, 239); variance by NIST/SEMATECH (e-Handbook, 6.3.2.4);
- limits from few sessions: Student's t in place of the normal distribution, as the limits' sd is an
  estimate, and a variance larger by that of the centre (F. S. Hillier, 1969, J. Qual. Tech. 1, 17).

The baseline's outliers are left out of the limits: they are found with the median moving range, divided by
0.954, which a single outlier hardly changes. A session farther off than its limits counts in the EWMA as if
it were at its limit, so that one outlier is not reported as a drift. Run rules (Western Electric, Nelson) are
not used: with the four of Western Electric a false alarm comes every 92 sessions (C. W. Champ and W. H.
Woodall, 1987, Technometrics 29, 393), and slow drifts are what the EWMA is for.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.special import ndtr, stdtrit

from analyze.types import Array

D2, D4 = 1.128, 0.954
"""mean, and median, of the range of two normal values over their sd"""
MIN_SESSIONS = 8
"""fewest sessions from which limits are computed"""
BASELINE = 20
"""number of sessions of the baseline, unless another is asked for or fewer exist"""
EWMA_WEIGHT, EWMA_SIGMAS = 0.2, 2.962
"""weight lambda of the latest session, and half width L of the limits in sd: one false alarm in 500 sessions
with known limits (J. M. Lucas and M. S. Saccucci, 1990, Technometrics 32, 1, table 3)"""
INDIVIDUAL_SIGMAS = 3.0
"""half width of the individual sessions' limits in sd"""
UNSTEADY_SIGMAS = 3.09
"""normal score of the baseline's order above which it counts as drifting: by chance one in a thousand"""
FALSE_ALARMS_PER_SESSION = 1.0 / 200.0
"""upper bound of the false alarms per session and chart, of both charts together (by simulation)"""
_FREEDOM_MEAN, _FREEDOM_MEDIAN = 0.605, 0.37
"""degrees of freedom per moving range of the sd by their mean (1 / (2*0.826), relative variance of the sd
0.826 per range), and by their median"""


@dataclass(frozen=True)
class ControlChart:
    """Individuals and EWMA chart of one quantity over n sessions in order of time, in the quantity's unit."""

    value: Array
    """(n,) values"""
    centre: float
    """mean of the baseline without outliers"""
    sd: float
    """sd from session to session by the baseline's mean moving range"""
    by_stated: bool
    """True if for most sessions the stated sd is the larger one, so that it makes the limits"""
    baseline: int
    """number of sessions of the baseline"""
    outliers: int
    """number of baseline sessions left out of centre and sd"""
    half: Array
    """(n,) half width of the individual sessions' limits about the centre"""
    ewma: Array
    """(n,) exponentially weighted moving average"""
    ewma_half: Array
    """(n,) half width of its limits about the centre"""
    unsteady: bool
    """True if the baseline itself drifts, so that its limits are too wide or off centre"""

    @property
    def outside(self) -> NDArray[np.bool_]:
        """Whether each session (n,) lies outside its limits."""
        return np.abs(self.value - self.centre) > self.half

    @property
    def drifted(self) -> NDArray[np.bool_]:
        """Whether the EWMA lies outside its limits at each session (n,)."""
        return np.abs(self.ewma - self.centre) > self.ewma_half

    @property
    def in_control(self) -> bool:
        """True if no session is outside its limits, the EWMA never was, and the baseline is steady."""
        return not (self.unsteady or self.outside.any() or self.drifted.any())

    @property
    def in_phase_two(self) -> int:
        """Number of sessions after the baseline."""
        return len(self.value) - self.baseline


def control_chart(value: Array, stated_sd: Array, baseline: int = BASELINE) -> ControlChart | None:
    """Control chart of a quantity; None for fewer than eight sessions, or if nothing varies.

    A session's limits are by the larger of two standard deviations: the baseline's moving range, which shows
    what varies between sessions, and the sd that the session itself states.

    Args:
        value: (n,) values in order of time.
        stated_sd: (n,) stated standard deviations in the same unit; NaN where none is stated.
        baseline: number of sessions of the baseline; all sessions if there are fewer.

    Raises:
        ValueError: the baseline is smaller than eight sessions.
    """
    if baseline < MIN_SESSIONS:
        raise ValueError(f"the baseline must have at least {MIN_SESSIONS} sessions, not {baseline}")
    if len(value) < MIN_SESSIONS:
        return None
    first = value[:baseline]
    kept = first[_plausible(first)]
    sd = float(np.abs(np.diff(kept)).mean()) / D2
    own = np.where(np.isnan(stated_sd), 0.0, stated_sd)
    if sd <= 1e-12 * float(np.abs(value).max(initial=0.0)) and not own.any():
        return None
    centre, freedom = float(kept.mean()), _FREEDOM_MEAN * (len(kept) - 1)
    # sd of each session times the quantile: the moving range's is an estimate, the stated one is known.
    wide = math.sqrt(1 + 1 / len(kept)) * np.maximum(_quantile(INDIVIDUAL_SIGMAS, freedom) * sd, 3.0 * own)
    away = np.clip(value - centre, -wide, wide)
    ewma: Array = np.asarray(lfilter([EWMA_WEIGHT], [1.0, EWMA_WEIGHT - 1.0], away))
    by_range = _quantile(EWMA_SIGMAS, freedom) * sd
    of_one = np.maximum(by_range, EWMA_SIGMAS * own)
    return ControlChart(
        value=value,
        centre=centre,
        sd=sd,
        by_stated=bool(np.median(own) > sd),
        baseline=min(baseline, len(value)),
        outliers=len(first) - len(kept),
        half=wide,
        ewma=centre + ewma,
        ewma_half=_ewma_half(of_one, len(kept)),
        unsteady=_drifts(kept),
    )


def _plausible(first: Array) -> NDArray[np.bool_]:
    """Whether each session of the baseline (m,) is within the limits by the median moving range."""
    sd = float(np.median(np.abs(np.diff(first)))) / D4
    reach = _quantile(INDIVIDUAL_SIGMAS, _FREEDOM_MEDIAN * (len(first) - 1)) * sd
    found = np.abs(first - np.median(first)) <= reach
    return found if np.count_nonzero(found) >= MIN_SESSIONS - 2 else np.ones(len(first), dtype=bool)


def _drifts(kept: Array) -> bool:
    """Whether the baseline's sessions (m,) follow each other more closely than a random order would.

    Ratio of the mean squared successive difference to the variance (J. von Neumann, 1941, Ann. Math. Stat.
    12, 367), near 2 for a random order, in its normal form (L. C. Young, 1941, ibid. 12, 293).
    """
    n, squares = len(kept), float(((kept - kept.mean()) ** 2).sum())
    ratio = float((np.diff(kept) ** 2).sum()) / squares if squares > 0 else 2.0
    return (1 - ratio / 2) * math.sqrt((n**2 - 1) / (n - 2)) > UNSTEADY_SIGMAS


def _quantile(sigmas: float, freedom: float) -> float:
    """Number of estimated sds that are exceeded as rarely as `sigmas` known ones by a normal value."""
    return float(stdtrit(freedom, ndtr(sigmas)))


def _ewma_half(of_one: Array, kept: int) -> Array:
    """Half widths (n,) of the EWMA's limits, from those of single sessions (n,) and the centre's variance.

    The variance of the EWMA is lambda^2 sum_j (1 - lambda)^(2 (t - j)) sd_j^2, for one sd the handbook's
    sd^2 lambda / (2 - lambda) (1 - (1 - lambda)^(2 t)); the error of the centre enters with what the EWMA
    has forgotten of its start, 1 - (1 - lambda)^t.
    """
    squares: Array = np.asarray(lfilter([EWMA_WEIGHT**2], [1.0, -((1.0 - EWMA_WEIGHT) ** 2)], of_one**2))
    seen = 1.0 - (1.0 - EWMA_WEIGHT) ** np.arange(1, len(of_one) + 1)
    return np.sqrt(squares + seen**2 * np.median(of_one) ** 2 / kept)
