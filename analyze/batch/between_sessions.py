"""Random-effects estimate of one quantity over the sessions of an object.

The model is y_i = mu + b_i + e_i: y_i is the value that session i reports, e_i has the stated sd s_i, and b_i
varies from session to session with the between-session sd tau. Steps and sources:

- tau by R. C. Paule and J. Mandel (1982, J. Res. NBS 87, 377, eq. 8): Q(tau^2) = n - 1; R. DerSimonian and
  R. Kacker (2007, Contemp. Clin. Trials 28, 105, eq. 16) derive it from moments;
- its 95 % interval by profiling Q (W. Viechtbauer, 2007, Stat. Med. 26, 37, eq. 18);
- the check of tau by restricted maximum likelihood (REML; Viechtbauer, 2005, J. Educ. Behav. Stat. 30, 261);
- the interval of mu by J. Hartung and G. Knapp (2001, Stat. Med. 20, 3875, eq. 8) and K. Sidik and
  J. N. Jonkman (2002, Stat. Med. 21, 3153): Student's t with n - 1 degrees of freedom;
- the p-value of homogeneity by W. G. Cochran (1954, Biometrics 10, 101): Q(0) is chi-square with n - 1.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.optimize import OptimizeResult, brentq, minimize_scalar
from scipy.special import chdtrc, chdtri, stdtr, stdtrit

from analyze.types import Array

ODD_PROBABILITY = 0.01
"""p-value, over all sessions together, below which one session counts as standing out"""
_TAIL = 0.025
_TIGHT = {"xatol": 1e-9}


@dataclass(frozen=True)
class LeftOut:
    """Estimate without one session, and that session against it; all in the unit of the values."""

    shift: float
    """mean of all sessions less the mean without this one"""
    between_sd: float
    """between-session sd of the others"""
    p_value: float
    """probability by chance of so large a distance of the session from the others; NaN for two sessions"""


@dataclass(frozen=True)
class SessionsEstimate:
    """Mean of a quantity over sessions and the sd between sessions, in the unit of the values."""

    sessions: int
    """number of sessions n"""
    mean: float
    """estimate of mu"""
    mean_sd: float
    """standard error of the mean (Hartung-Knapp); NaN for one session"""
    mean_half: float
    """half width of the mean's 95 % interval; NaN for one session"""
    between_sd: float
    """tau by Paule and Mandel; NaN for one session"""
    between_interval: tuple[float, float]
    """95 % interval of tau by profiling Q; NaN for one session"""
    between_sd_reml: float
    """tau by REML, as a check; NaN for one session"""
    prediction_half: float
    """half width of the 95 % interval, about the mean, of what a new session would report; NaN for one"""
    chi_square: float
    """Cochran's Q: chi-square of the values about their weighted mean with the stated sds"""
    p_value: float
    """probability by chance of so large a Q if nothing varied between sessions; NaN for one session"""
    stated_sd: float
    """median of the stated sds"""
    scatter: float
    """sd of the values from session to session; NaN for one session"""
    left_out: tuple[LeftOut, ...]
    """for each session the estimate without it; empty with fewer than three sessions, or if not asked for"""

    @property
    def odd(self) -> tuple[int, ...]:
        """Indices of the sessions that stand out: Bonferroni-corrected p-value below `ODD_PROBABILITY`."""
        limit = ODD_PROBABILITY / max(1, self.sessions)
        return tuple(i for i, each in enumerate(self.left_out) if each.p_value < limit)

    @property
    def scatter_ratio(self) -> float:
        """Scatter from session to session over the median stated sd; NaN for one session."""
        return self.scatter / self.stated_sd


def estimate_over_sessions(value: Array, sd: Array, *, influence: bool = True) -> SessionsEstimate:
    """Random-effects estimate of a quantity from the sessions' values and stated standard deviations.

    Args:
        value: (n,) values of n sessions, n at least 1, in any unit.
        sd: (n,) stated standard deviations, above 0, in the same unit.
        influence: True to estimate without each session in turn as well.

    Raises:
        ValueError: there is no session, or a value is not finite, or an sd is not above 0.
    """
    if not len(value) or not np.all(np.isfinite(value)) or not np.all((sd > 0) & np.isfinite(sd)):
        raise ValueError("every session needs a finite value and an sd above 0")
    unit, origin = float(np.median(sd)), float(np.median(value))
    # In units of the median sd about the median: moments of inertia and lengths have very different sizes.
    y, s = (value - origin) / unit, sd / unit
    found = _estimate(y, s)
    return SessionsEstimate(
        sessions=len(value),
        mean=origin + unit * found.mean,
        mean_sd=unit * found.se,
        mean_half=unit * found.mean_half,
        between_sd=unit * found.tau,
        between_interval=(unit * found.tau_ends[0], unit * found.tau_ends[1]),
        between_sd_reml=unit * found.tau_reml,
        prediction_half=unit * found.prediction_half,
        chi_square=found.chi_square,
        p_value=found.p_value,
        stated_sd=unit,
        scatter=float(value.std(ddof=1)) if len(value) > 1 else math.nan,
        left_out=tuple(_left_out(y, s, found.mean, unit)) if influence and len(value) > 2 else (),
    )


def homogeneity(value: Array, covariance: Array) -> tuple[float, int, float]:
    """Test whether vectors of several sessions agree within their stated covariances (Cochran's Q, jointly).

    Q is the sum of (y_i - m)^T S_i^-1 (y_i - m), m the mean weighted by S_i^-1; if the sessions agree, it is
    chi-square with (n - 1)*p degrees of freedom.

    Args:
        value: (n, p) vectors of n sessions.
        covariance: (n, p, p) stated covariances.

    Returns:
        Q, its degrees of freedom, and the probability of so large a Q by chance.

    Raises:
        numpy.linalg.LinAlgError: a covariance is singular.
    """
    weight = np.linalg.inv(covariance)
    mean = np.linalg.solve(weight.sum(axis=0), np.einsum("nij,nj->i", weight, value))
    away = value - mean
    chi_square = float(np.einsum("ni,nij,nj->", away, weight, away))
    freedom = (len(value) - 1) * value.shape[1]
    return chi_square, freedom, float(chdtrc(freedom, chi_square)) if freedom else math.nan


def paule_mandel(value: Array, sd: Array) -> float:
    """Between-session sd tau by Paule and Mandel (1982): Q(tau^2) = n - 1, or 0 if Q(0) is smaller.

    Args:
        value: (n,) values, n at least 2.
        sd: (n,) stated standard deviations.
    """
    return math.sqrt(_variance_at(value, sd, float(len(value) - 1)))


def q_profile_interval(value: Array, sd: Array) -> tuple[float, float]:
    """95 % interval of the between-session sd: Q at its ends is a quantile of chi-square with n - 1 dof.

    Args:
        value: (n,) values, n at least 2.
        sd: (n,) stated standard deviations.
    """
    freedom = len(value) - 1
    # `chdtri` takes the probability above.
    low, high = (_variance_at(value, sd, float(chdtri(freedom, tail))) for tail in (_TAIL, 1 - _TAIL))
    return math.sqrt(low), math.sqrt(high)


def restricted_likelihood_sd(value: Array, sd: Array) -> float:
    """Between-session sd by restricted maximum likelihood (REML).

    Args:
        value: (n,) values, n at least 2.
        sd: (n,) stated standard deviations.
    """

    def loss(tau: float) -> float:
        variance = sd**2 + tau**2
        weight = 1.0 / variance
        return float(np.log(variance).sum() + math.log(weight.sum()) + weighted_chi_square(value, sd, tau**2))

    highest = 2.0 * float(np.ptp(value)) + 1e-9 * float(sd.min())
    start = np.linspace(0.0, highest, 60)
    best = int(np.argmin([loss(tau) for tau in start]))
    bounds = (start[max(best - 1, 0)], start[min(best + 1, len(start) - 1)])
    solved = cast("OptimizeResult", minimize_scalar(loss, bounds=bounds, method="bounded", options=_TIGHT))
    found = float(solved.x)
    return found if loss(found) < loss(0.0) else 0.0


def weighted_chi_square(value: Array, sd: Array, variance: float) -> float:
    """Q: chi-square of values (n,) about their mean, both weighted by 1 / (sd^2 + variance), sd (n,)."""
    weight = 1.0 / (sd**2 + variance)
    return float(weight @ (value - weight @ value / weight.sum()) ** 2)


@dataclass(frozen=True)
class _Standardised:
    """Estimate in the unit of its arguments."""

    mean: float
    se: float
    mean_half: float
    tau: float
    tau_ends: tuple[float, float]
    tau_reml: float
    prediction_half: float
    chi_square: float
    p_value: float


def _estimate(y: Array, s: Array) -> _Standardised:
    n = len(y)
    if n == 1:
        nan = math.nan
        return _Standardised(float(y[0]), nan, nan, nan, (nan, nan), nan, nan, 0.0, nan)
    tau = paule_mandel(y, s)
    mean, se, factor = _mean(y, s, tau)
    t, q = float(stdtrit(n - 1, 1 - _TAIL)), weighted_chi_square(y, s, 0.0)
    # What a new session reports has the scatter of the others: below the stated sd if they agree better.
    new = factor * (tau**2 + float(np.median(s)) ** 2)
    return _Standardised(
        mean=mean,
        se=se,
        mean_half=t * se,
        tau=tau,
        tau_ends=q_profile_interval(y, s),
        tau_reml=restricted_likelihood_sd(y, s),
        prediction_half=t * math.sqrt(new + se**2),
        chi_square=q,
        p_value=float(chdtrc(n - 1, q)),
    )


def _mean(y: Array, s: Array, tau: float) -> tuple[float, float, float]:
    """Weighted mean, its standard error (Hartung-Knapp), and the factor q of the variances in it."""
    weight = 1.0 / (s**2 + tau**2)
    mean = float(weight @ y / weight.sum())
    factor = weighted_chi_square(y, s, tau**2) / (len(y) - 1)
    return mean, math.sqrt(factor / float(weight.sum())), factor


def _left_out(y: Array, s: Array, mean: float, unit: float) -> list[LeftOut]:
    found: list[LeftOut] = []
    for i in range(len(y)):
        others, sds = np.delete(y, i), np.delete(s, i)
        tau = paule_mandel(others, sds)
        without, se, factor = _mean(others, sds, tau)
        # Stated sds hold unless the others scatter more: an agreement by chance makes no session stand out.
        spread = math.sqrt(max(1.0, factor) * (tau**2 + s[i] ** 2) + se**2)
        p_value = 2.0 * float(stdtr(len(others) - 1, -abs(float(y[i]) - without) / spread))
        found.append(LeftOut(unit * (mean - without), unit * tau, p_value))
    return found


def _variance_at(value: Array, sd: Array, target: float) -> float:
    """Between-session variance at which Q is `target`; 0 if Q(0) is not larger."""
    if weighted_chi_square(value, sd, 0.0) <= target:
        return 0.0
    # Q(v) <= sum (y - mean)^2 / v, so that the root lies below this bound.
    highest = float(((value - value.mean()) ** 2).sum()) / target
    highest *= 1 + 1e-9
    return cast(
        "float", brentq(lambda v: weighted_chi_square(value, sd, v) - target, 0.0, highest, xtol=1e-14)
    )
