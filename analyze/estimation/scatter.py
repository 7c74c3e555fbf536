"""Scatter of phi from strike to strike and tilt of the table, as large as the strikes show them to be.

A crumb under the object, a careless hand or a soft table turns the rest pose of one strike about its edge.
Its balance angle phi is then measured rightly, but from a pose that is not the planned one. The sd of this
error is a variance component: an unknown with a prior about what is stated, estimated by the likelihood of
all measurements in which centre of mass, inertia and other errors are integrated out (restricted likelihood:
Patterson and Thompson 1971). The sd of the table's tilt is estimated likewise.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.joint_model import JointModel
from analyze.estimation.priors import SystematicErrors
from analyze.estimation.strike_data import strike_data, whitened
from analyze.least_squares.intervals import SIGMAS_95, TAIL_95, normal_sd
from analyze.types import Array

PRIOR_FREEDOM = 2.0
"""Degrees of freedom of the sds' priors (scaled inverse chi-squared): the error has Student's t."""
SCATTER_FACTORS = np.geomspace(0.2, 60.0, 64)
"""Factors on the scatter's stated sd at which its likelihood is evaluated; 60 times the usual 0.03 degrees
are 1.7 degrees."""
SCATTER_SCALE = SIGMAS_95 / 4.303
"""Scale of the prior of that factor; with 2 degrees of freedom the 95 % interval of t is then as stated."""
EXCESS_FACTOR = 1.5
"""Factor on the stated sd above which the scatter is reported if its whole 95 % interval lies there."""
TILT_FACTORS = np.geomspace(0.2, 10.0, 14)
"""Factors on the stated sd of the table's tilt at which its likelihood is evaluated."""
TILT_SCALE = 0.83
"""Scale of the prior of that factor, whose median is then 1: a table is seldom as level as it is believed."""
SIMILAR = 0.05
"""Relative difference of two factors up to which they count as the same."""


@dataclass(frozen=True)
class ErrorFactors:
    """Factors on the stated sd of the scatter from strike to strike, and of the table's tilt."""

    scatter: float = 1.0
    """Factor on `SystematicErrors.strike_angle_sd`."""
    tilt: float = 1.0
    """Factor on the sd of the tilts of all levellings (set-ups of the table)."""
    scatter_interval: tuple[float, float] = (0.0, float(SCATTER_FACTORS[-1]))
    """95 % interval of the factor on `SystematicErrors.strike_angle_sd`."""

    def applied(self, stated: SystematicErrors) -> SystematicErrors:
        """Errors `stated` before the strikes, with the sd of scatter and tilt multiplied by the factors."""
        return replace(
            stated.with_tilt_factor(self.tilt), strike_angle_sd=self.scatter * stated.strike_angle_sd
        )

    def similar(self, other: ErrorFactors) -> bool:
        """True if both factors equal those of `other` to within `SIMILAR` of their size."""
        ratios = np.array([self.scatter / other.scatter, self.tilt / other.tilt])
        return bool(np.all(np.abs(np.log(ratios)) < SIMILAR))


@dataclass(frozen=True)
class ScatterRange:
    """Sd of the balance angle from strike to strike beyond the fits' errors: stated, and by the strikes."""

    stated: float
    """1 sigma before any strike [rad]."""
    low: float
    """Lower end of the 95 % interval of the sd by the strikes [rad]."""
    high: float
    """Upper end of that interval [rad]."""

    @property
    def exceeds(self) -> bool:
        """True if the whole 95 % interval of the sd lies above `EXCESS_FACTOR` times the stated sd."""
        return self.low > EXCESS_FACTOR * self.stated


def scatter_range(stated: SystematicErrors, factors: ErrorFactors) -> ScatterRange:
    """Sd of the balance angle from strike to strike [rad] as `stated`, and its 95 % interval by `factors`."""
    sd = stated.strike_angle_sd
    low, high = factors.scatter_interval
    return ScatterRange(sd, low * sd, high * sd)


def estimated_factors(
    model: JointModel,
    stated: SystematicErrors,
    present: ErrorFactors,
    weight: Array,
    x: Array,
    prior: tuple[Array, Array],
    with_k: bool,
) -> ErrorFactors:
    """Factors on the stated sd of scatter and tilt, from the strikes.

    They are those with which a normal error has the 95 % interval of the posterior, in which the factor is
    uncertain: the fewer strikes determine it, the larger, as with Student's t. The 95 % interval of the
    scatter's factor is returned too. The problem is linearised at the unknowns `x`.

    Args:
        model: Model of the strikes, with the sds of scatter and tilt that `present` makes of the stated ones.
        stated: Shared errors as stated before any strike.
        present: Factors that the problem was last solved with.
        weight: (strikes,) robust weights, which divide the variances of a strike's errors.
        x: (count,) unknowns of least misfit.
        prior: Mean (count,) and covariance (count, count) of the unknowns before any strike.
        with_k: True to use the rate constants k beside the balance angles phi.
    """
    own = strike_data(model.planes, 0.0, with_k)
    z, rows = whitened(model, own, x)
    root, n = np.sqrt(weight), len(weight)
    used = np.stack([np.ones(n), own.uses_k], axis=1).ravel() > 0
    design = (rows * root[:, None, None]).reshape(-1, model.count)[used]
    mean, covariance = prior
    residual = (z * root[:, None]).ravel()[used] - design @ (x - mean)
    # The scatter's variance is divided by the weight too, as that of the fit.
    by_phi = own.whiten[:, :, 0, None] * np.eye(n)[:, None, :]
    by_scatter = stated.strike_angle_sd * by_phi.reshape(-1, n)[used]
    tilts = np.concatenate([np.r_[model.tilt_terms(level)] for level in range(len(model.tilts))])
    of_tilt = design[:, tilts] @ design[:, tilts].T
    level_table = np.eye(len(design)) + design @ covariance @ design.T - of_tilt
    tilted = level_table + ((TILT_FACTORS / present.tilt) ** 2)[:, None, None] * of_tilt
    density = _log_likelihood(tilted, by_scatter, residual)
    density += (
        factor_log_prior(SCATTER_FACTORS, SCATTER_SCALE) + factor_log_prior(TILT_FACTORS, TILT_SCALE)[:, None]
    )
    probability = np.exp(density - density.max())
    probability /= probability.sum()
    scatter = probability.sum(axis=0)
    low, high = np.interp([TAIL_95, 1 - TAIL_95], np.cumsum(scatter), SCATTER_FACTORS)
    return ErrorFactors(
        normal_sd(SCATTER_FACTORS, scatter),
        normal_sd(TILT_FACTORS, probability.sum(axis=1)),
        (float(low), float(high)),
    )


def factor_log_prior(factors: Array, scale: float, freedom: float = PRIOR_FREEDOM) -> Array:
    """Log density of the logarithm of factors (n,) on a stated sd, up to a constant.

    The factors' squares are scaled inverse chi-squared, with `freedom` and the square of `scale`.
    """
    return np.asarray(-freedom * (np.log(factors) + 0.5 * (scale / factors) ** 2), dtype=np.float64)


def _log_likelihood(covariance: Array, by_scatter: Array, residual: Array) -> Array:
    """Log likelihood (tilts, k), up to a constant, of the measurements for k factors on the sd of scatter.

    The scatter is that of the balance angle from strike to strike; the factors are `SCATTER_FACTORS`. With V
    the covariance, H the derivative and r the residuals, it is -(ln det(V + s^2 H H^T) + r^T (V + s^2 H
    H^T)^-1 r) / 2 for a factor s.

    Args:
        covariance: (tilts, n, n) V, for several sds of the table's tilt: of the standardised measurements
            without scatter, errors that strikes share and all other unknowns included.
        by_scatter: (n, strikes) H, their derivatives by each strike's scatter, in units of its stated sd.
        residual: (n,) r, modelled minus measured, at the prior's mean of the unknowns.
    """
    root = np.linalg.cholesky(covariance)
    solved = np.linalg.solve(root, np.column_stack([by_scatter, residual]))
    H, r = solved[:, :, :-1], solved[:, :, -1:]
    H_T = np.swapaxes(H, 1, 2)
    values, vectors = np.linalg.eigh(H_T @ H)
    along = np.swapaxes(vectors, 1, 2) @ (H_T @ r)
    squares = SCATTER_FACTORS[:, None] ** 2
    grown = 1 + squares * np.maximum(values, 0.0)[:, None]
    misfit = np.sum(r**2, axis=1) - np.sum(squares * along[:, None, :, 0] ** 2 / grown, axis=2)
    log_det = 2 * np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)[:, None]
    return np.asarray(-0.5 * (misfit + log_det + np.sum(np.log(grown), axis=2)), dtype=np.float64)
