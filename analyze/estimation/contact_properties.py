"""Friction, restitution and rolling loss of one object on one table, from all strikes together.

Friction: every strike gives a likelihood of the coefficient mu, closed where its edge slid, open upwards
where it held. They are multiplied, each first blurred by the scatter of mu from strike to strike, which is
itself unknown (a random-effects meta-analysis; Higgins, Thompson and Spiegelhalter 2009). Restitution: the
mean over landings and their scatter beyond the errors (DerSimonian and Laird 1986).
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import logsumexp

from analyze.least_squares.intervals import SIGMAS_95, student_sigmas_95

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.types import Array

LEAST_SLIDE_M = 5e-4
"""least sliding [m] of an edge in one strike at which a value is given: edges creep by some tenths of a
millimetre before they slide, which alone bounds friction from below"""
LOWEST_MU, HIGHEST_MU = 0.05, 2.0
"""range of coefficients of friction that are considered"""
_STEP = 0.002
"""step of the grid of ln mu"""
_SCATTERS = np.array([0.0, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16])
"""scatters of ln mu from strike to strike that are tried"""
_SCATTER_SCALE = 0.03
"""scale of the exponential prior of that scatter: dry friction repeats to some per cent"""
_SHARED_SD = 0.025
"""relative error that all strikes share: the lens's strain, the distance of the centre of mass, and edges
that slide a little early (simulated strikes are 1 to 3 % low)"""
_NODES = 15
"""points at which shared errors are tried"""
_TWO_SIDED, _ONE_SIDED = 3.84, 2.71
"""chi^2 at the ends of a 95 % interval, and at a bound that holds with 95 %"""
_OPEN_MU = 1.7
"""upper end of an interval from which it counts as open"""
MAX_MEASURED_MU = 0.42
"""largest coefficient that tips measure: |T|/N stays below 0.37 while the edge carries weight, so that an
edge with more friction slides only where it is nearly unloaded (simulated: 0.07 to 0.11 off)"""
_VALUE_WIDTH = 0.5
"""largest half-width of an interval over its value at which friction counts as measured"""


@dataclass(frozen=True)
class StrikeFriction:
    """Evidence of one strike on the coefficient of friction."""

    strike_id: str
    """id of the strike"""
    mu: Array
    """(m,) coefficients, ascending"""
    chi2: Array
    """(m,) chi^2 at each, less the least; level beyond the last"""
    slid: float
    """range of the edge's sliding in the frames used [m]"""
    held_ratio: float | None
    """largest lasting |T|/N while the edge held; None if it slid throughout"""
    held_sd: float | None
    """its standard deviation"""


@dataclass(frozen=True)
class Friction:
    """Coefficient of friction between the object's edges and the table."""

    value: float | None
    """coefficient; None if no edge slid enough: then `bound` alone is known"""
    sd: float | None
    """standard deviation"""
    interval: tuple[float, float] | None
    """95 % interval"""
    bound: float
    """lower bound that holds with 95 %"""
    scatter: float | None
    """relative scatter from strike to strike beyond the errors; None with fewer than two strikes that slid"""
    strikes: tuple[StrikeFriction, ...]
    """evidence of each strike"""


@dataclass(frozen=True)
class LandingRestitution:
    """Restitution of one landing."""

    strike_id: str
    """id of the strike"""
    value: float
    """coefficient: speed of the line that lands, after over before"""
    sd: float
    """its standard deviation"""
    upper: float | None
    """upper limit (95 %) where no rebound is resolved"""
    speed: float
    """speed of the line before [m/s]"""
    omega_before: float
    """angular speed before [rad/s]"""
    omega_after: float
    """angular speed after [rad/s]"""


@dataclass(frozen=True)
class Restitution:
    """Distribution of the coefficient of restitution over landings."""

    mean: float
    """mean over landings"""
    sd: float
    """standard deviation of the mean"""
    interval: tuple[float, float]
    """95 % interval of the mean"""
    scatter: float | None
    """standard deviation from landing to landing beyond the errors; None for one landing"""
    landings: tuple[LandingRestitution, ...]
    """each landing"""


@dataclass(frozen=True)
class RollingResistance:
    """Rolling resistance over the object's edges: distance by which the load acts ahead of the contact."""

    arm: float
    """mean over strikes that rocked back [m]"""
    sd: float
    """its standard deviation [m]"""
    strikes: int
    """number of strikes"""


@dataclass(frozen=True)
class ContactProperties:
    """Properties of the contact between the object and the table of its recordings."""

    table: str
    """name of the table"""
    friction: Friction | None
    """coefficient of friction; None if no strike shows any bound"""
    restitution: Restitution | None
    """restitution at landings; None if no landing was seen"""
    rolling: RollingResistance | None
    """rolling resistance; None if no strike rocked back far enough"""


def held_evidence(ratio: float, sd: float) -> tuple[Array, Array]:
    """Coefficients (m,) and chi^2 (m,) of an edge that held while it needed a ratio of forces, with sd."""
    mu = np.unique(np.concatenate([[LOWEST_MU], ratio + sd * np.linspace(-6.0, 0.0, 25), [HIGHEST_MU]]))
    mu = mu[mu >= LOWEST_MU]
    return mu, np.where(mu < ratio, ((ratio - mu) / sd) ** 2, 0.0)


def combined_friction(strikes: Sequence[StrikeFriction], tilt_sd: float) -> Friction | None:
    """Coefficient of friction from all strikes; None without any evidence.

    Args:
        strikes: evidence of each strike.
        tilt_sd: standard deviation of the vertical's lean against the table's normal [rad], which all strikes
            share: it is part of a friction angle.
    """
    if not strikes:
        return None
    ln_mu = np.arange(math.log(LOWEST_MU), math.log(HIGHEST_MU), _STEP)
    each = np.array([-0.5 * np.interp(np.exp(ln_mu), one.mu, one.chi2) for one in strikes])
    by_scatter = np.array([_blurred(each, scatter).sum(axis=0) for scatter in _SCATTERS])
    prior = -_SCATTERS / _SCATTER_SCALE
    joint = by_scatter + prior[:, None]
    total = _with_shared_error(ln_mu, np.asarray(logsumexp(joint, axis=0)), tilt_sd)
    chi2 = -2.0 * (total - total.max())
    mu = np.exp(ln_mu)
    inside = np.flatnonzero(chi2 <= _TWO_SIDED)
    low, high = float(mu[inside[0]]), float(mu[inside[-1]])
    bound = float(mu[np.flatnonzero(chi2 <= _ONE_SIDED)[0]])
    best = float(mu[int(np.argmax(total))])
    slides = any(one.slid > LEAST_SLIDE_M for one in strikes)
    if best > MAX_MEASURED_MU:
        return Friction(None, None, None, min(bound, MAX_MEASURED_MU), None, tuple(strikes))
    if not slides or high > _OPEN_MU or high - low > 2 * _VALUE_WIDTH * best:
        return Friction(None, None, None, bound, None, tuple(strikes))
    posterior = np.exp(joint - joint.max())
    scatter = float(_SCATTERS @ posterior.sum(axis=1) / posterior.sum())
    closed = sum(float(one.chi2[-1]) > _TWO_SIDED for one in strikes)
    sd = (high - low) / (2 * SIGMAS_95)
    return Friction(best, sd, (low, high), bound, scatter if closed > 1 else None, tuple(strikes))


def _with_shared_error(ln_mu: Array, total: Array, tilt_sd: float) -> Array:
    """Log-likelihood (n,) over ln mu (n,), with the errors that all strikes share.

    They are the tilt, and a share for lens, clock and the distance of the centre of mass.
    """
    mu = np.exp(ln_mu)
    shift = np.hypot(tilt_sd * (1 + mu**2) / mu, _SHARED_SD)
    nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
    parts = [
        np.interp(ln_mu - shift * node, ln_mu, total) + math.log(weight)
        for node, weight in zip(nodes, weights, strict=True)
    ]
    return np.asarray(logsumexp(np.array(parts), axis=0))


def _blurred(log_likelihood: Array, scatter: float) -> Array:
    """Log-likelihoods (s, n) over ln mu, blurred by a normal scatter of ln mu."""
    reach = math.ceil(4 * scatter / _STEP)
    if reach == 0:
        return log_likelihood
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * _STEP / scatter) ** 2)
    kernel /= kernel.sum()
    top = log_likelihood.max(axis=1, keepdims=True)
    padded = np.pad(np.exp(log_likelihood - top), ((0, 0), (reach, reach)), mode="edge")
    smooth = np.array([np.convolve(row, kernel, mode="valid") for row in padded])
    return np.log(np.maximum(smooth, 1e-300)) + top


def combined_restitution(landings: Sequence[LandingRestitution]) -> Restitution | None:
    """Mean and scatter of the restitution over landings; None without any."""
    if not landings:
        return None
    value, sd = np.array([each.value for each in landings]), np.array([each.sd for each in landings])
    n = len(value)
    weight = 1 / sd**2
    mean = float(weight @ value / weight.sum())
    spread = float(weight @ (value - mean) ** 2) - (n - 1)
    between = max(0.0, spread / float(weight.sum() - (weight**2).sum() / weight.sum())) if n > 1 else 0.0
    weight = 1 / (sd**2 + between)
    mean = float(weight @ value / weight.sum())
    error = 1 / math.sqrt(float(weight.sum()))
    if n > 1:
        # Hartung and Knapp 2001: the scatter is itself estimated.
        seen = float(weight @ (value - mean) ** 2) / ((n - 1) * float(weight.sum()))
        error = max(error, math.sqrt(seen))
        sigmas = float(student_sigmas_95(np.array([n - 1.0]))[0]) if between > 0 else SIGMAS_95
    else:
        sigmas = SIGMAS_95
    low, high = max(0.0, mean - sigmas * error), mean + sigmas * error
    scatter = math.sqrt(between) if n > 1 else None
    return Restitution(mean, error, (low, high), scatter, tuple(landings))


def combined_rolling(arms: Sequence[tuple[float, float]]) -> RollingResistance | None:
    """Rolling resistance from strikes' arms and standard deviations [m]; None without any."""
    if not arms:
        return None
    value, sd = np.array(arms).T
    weight = 1 / sd**2
    mean = float(weight @ value / weight.sum())
    error = 1 / math.sqrt(float(weight.sum()))
    if len(value) > 1:
        error *= math.sqrt(max(1.0, float(weight @ (value - mean) ** 2) / (len(value) - 1)))
    return RollingResistance(mean, error, len(value))
