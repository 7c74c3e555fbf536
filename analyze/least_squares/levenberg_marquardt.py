"""Levenberg-Marquardt with Huber's loss by re-weighting (Huber 1964), and its result's covariance.

The loss is scaled by the residuals' own median absolute deviation where that exceeds the stated noise, and
the scale follows the fit from step to step. `scipy.optimize.least_squares` takes a fixed scale:
docs/decisions/0028 compares the two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.least_squares.robust import correlation_factor, huber_weights, median_scale

if TYPE_CHECKING:
    from collections.abc import Callable

    from analyze.types import Array

    Model = Callable[[Array], tuple[Array, Array]]
    """Expected observations (n,) at parameters (p,), and their derivatives (n, p)."""

HUBER_THRESHOLD = 2.5
"""Standard deviations above which a residual counts less than its square."""
MAX_STEPS = 40
"""Number of steps after which the iteration ends, unless another is given."""
_START_DAMPING = 1e-3
_MAX_DAMPING = 1e9
_MIN_POSITIVE = 0.1
"""Lower bound of the parameter that must stay positive."""
_STEP_TOLERANCE = 1e-5
"""Largest step, as a share of each parameter's scale, that ends the iteration."""
_WEIGHT_TOLERANCE = 1e-3
"""Largest change of a weight that ends the iteration."""


@dataclass(frozen=True)
class Minimum:
    """Result of a robust least-squares fit: best parameters (p,), with residuals and Huber weights there.

    Residuals (n,) are observed less expected values, in the observations' unit; the derivatives (n, p) are
    those of the expected values by the parameters. A weight (n,) is 1 for a small residual and falls towards
    0 for an outlier.
    """

    parameters: Array
    """(p,) best parameters"""
    residual: Array
    """(n,) observed minus expected, in the observations' unit"""
    jacobian: Array
    """(n, p) derivatives of the expected values by the parameters"""
    weight: Array
    """(n,) weights of Huber's loss, 0..1"""


@dataclass(frozen=True)
class Ending:
    """When the iteration of `minimise` ends, besides after small steps."""

    max_steps: int = MAX_STEPS
    """number of steps after which it ends, converged or not"""
    least_gain: float = 0.0
    """decrease of the sum of squares by a nearly undamped step below which it ends, and growth by a refused
    step below which it ends as well; 0: small steps alone"""
    halve_above: float = math.inf
    """sum of squares above which the first step must halve it, or the iteration ends there: a model that fits
    is nearly linear so close to its start, and the first step takes most away"""
    damping_kept: int = 0
    """number of steps after a refused one in which the damping is not lowered: where valleys are long and
    curved, a lower damping is refused every second time"""


def minimise(
    observed: Array,
    sd: Array,
    model: Model,
    start: Array,
    scale: Array,
    positive_index: int = 1,
    ending: Ending = Ending(),
) -> Minimum:
    """Parameters (p,) that minimise the Huber loss of (observed - expected) / sd.

    Args:
        observed: (n,) observations, in any unit.
        sd: (n,) their standard deviations, in the same unit.
        model: function of the parameters (p,) that gives the expected values (n,) and their derivatives
            (n, p) by the parameters.
        start: (p,) first parameters.
        scale: (p,) typical changes of the parameters, for conditioning and convergence.
        positive_index: index of the parameter that must stay above 0.1, in its own unit.
        ending: when the iteration ends.

    Returns:
        Parameters (p,) after the last accepted step; there, the residuals (n,) observed - expected in the
        observations' unit, the derivatives (n, p) of the expected values by the parameters, and Huber's
        weight (n,), 0..1, of each observation. The iteration may end before it has converged.
    """

    def evaluate(x: Array) -> tuple[Array, Array]:
        expected, jacobian = model(x)
        return observed - expected, jacobian

    x, damping, kept = start.copy(), _START_DAMPING, 0
    residual, jacobian = evaluate(x)
    weight = _weights(residual / sd)
    cost = float(np.sum(weight * (residual / sd) ** 2))
    for number in range(ending.max_steps):
        J = jacobian * (np.sqrt(weight) / sd)[:, None] * scale
        r = residual * np.sqrt(weight) / sd
        normal, gradient = J.T @ J, J.T @ r
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), gradient) * scale
        trial = x + step
        if trial[positive_index] <= _MIN_POSITIVE:
            damping *= 10
            continue
        new_residual, new_jacobian = evaluate(trial)
        new_cost = float(np.sum(weight * (new_residual / sd) ** 2))
        if number == 0 and cost > ending.halve_above and not new_cost < 0.5 * cost:
            break
        if not math.isfinite(new_cost) or new_cost > cost * (1 + 1e-9) + 1e-12:
            damping, kept = damping * 8, ending.damping_kept
            if damping > _MAX_DAMPING or new_cost - cost < ending.least_gain:
                break
            continue
        gained_little = damping <= _START_DAMPING and abs(cost - new_cost) < ending.least_gain
        x, residual, jacobian = trial, new_residual, new_jacobian
        damping, kept = (damping, kept - 1) if kept else (max(damping / 8, 1e-12), 0)
        converged = bool(np.all(np.abs(step) < _STEP_TOLERANCE * scale))
        new_weight = _weights(residual / sd)
        settled = bool(np.max(np.abs(new_weight - weight)) < _WEIGHT_TOLERANCE)
        weight = new_weight
        cost = float(np.sum(weight * (residual / sd) ** 2))
        if gained_little or (converged and settled):
            break
    return Minimum(x, residual, jacobian, weight)


def with_differences(expected: Callable[[Array], Array], steps: Array) -> Model:
    """Model for `minimise` (values and derivatives) from a function that gives values only.

    The derivatives are central differences; the function takes many sets of parameters at once.

    Args:
        expected: function that gives the observations (n, c) of c sets of parameters (c, p).
        steps: (p,) differentiation steps of the parameters.

    Returns:
        Function that gives observations (n,) and derivatives (n, p) at parameters (p,).
    """
    p = len(steps)
    offsets = np.concatenate([np.zeros((1, p)), np.diag(steps), -np.diag(steps)])

    def model(x: Array) -> tuple[Array, Array]:
        """Expected observations (n,) at parameters `x` (p,), and their derivatives (n, p) by `x`."""
        found = expected(x + offsets)
        return found[:, 0], (found[:, 1 : p + 1] - found[:, p + 1 :]) / (2 * steps)

    return model


def _weights(standardised: Array) -> Array:
    """Huber weights (n,) in 0..1 of standardised residuals (n,): 1 up to a threshold, less beyond it.

    The threshold is `HUBER_THRESHOLD` sd, scaled by the residuals' own spread where that exceeds the stated
    noise.
    """
    return huber_weights(standardised, HUBER_THRESHOLD, max(1.0, median_scale(standardised)))


def unit_covariance(minimum: Minimum, sd: Array, scale: Array) -> Array:
    """Covariance (p, p) of a robust fit's parameters, to be multiplied by the variance of its residuals.

    That variance is `residual_variance`, unitless. With variance 1 the result is (J^T W J)^-1, where J (n, p)
    holds the derivatives of the expected values by the parameters, over the observations' sd, and W the Huber
    weights.

    Args:
        minimum: the fit.
        sd: (n,) standard deviations of the observations.
        scale: (p,) typical changes of the parameters, for conditioning.
    """
    J = minimum.jacobian * (np.sqrt(minimum.weight) / sd)[:, None]
    inverse = np.linalg.pinv((J * scale).T @ (J * scale), rcond=1e-14, hermitian=True)
    return np.asarray(inverse * np.outer(scale, scale), dtype=np.float64)


def residual_variance(minimum: Minimum, sd: Array) -> float:
    """Variance of a fit's weighted residuals (unitless), inflated if neighbours are correlated.

    The covariance of the fit's parameters is this variance times `unit_covariance`, the covariance for
    residuals of unit variance. Let psi be the residuals over the observations' sd, times the Huber weights
    (below 1 for outliers), and psi' its derivative by the residual, for n residuals and p parameters.
    Huber's asymptotic variance is sum psi^2 / (n - p) over (mean psi')^2. Two things differ here.
    The divisor is n - p - 2, at least 1, which gives the variance of Student's t, because intervals are
    computed as for a normal variable. The mean of psi', which is the share of residuals with full weight,
    counts as at least 0.5.

    Args:
        minimum: the fit.
        sd: (n,) standard deviations of the observations.
    """
    n, p = minimum.jacobian.shape
    psi = minimum.weight * (minimum.residual / sd)
    inside = max(0.5, float(np.mean(minimum.weight > 0.999)))
    return float(np.sum(psi**2)) / max(n - p - 2, 1) / inside**2 * correlation_factor(psi)
