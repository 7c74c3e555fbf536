"""Probability that a statement of edge radii is wrong, by the strikes' own information on the radii."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from __future__ import annotations

import numpy as np
from scipy.special import expit

from analyze.types import Array

WRONG_FRACTION = 0.1
"""Probability, before any strike, that a stated radius is wrong and says nothing about any edge."""


def probability_wrong(score: Array, information: Array, priors: tuple[Array, Array], offset: Array) -> float:
    """Probability that stated radii of n edges are wrong: that the edges are like those of any object.

    The odds are those before the strikes (`WRONG_FRACTION`) times the ratio of the strikes' marginal
    likelihoods, with radii about the stated ones and with those assumed where none is given.

    Args:
        score: (n,) derivative of the strikes' log likelihood by the radii, at the stated ones [1/m].
        information: (n, n) the strikes' own information (inverse covariance) on the radii [1/m^2].
        priors: (n, n) covariances [m^2] of the stated radii, and of radii that are not given.
        offset: (n,) mean of radii that are not given, minus the stated ones [m].
    """
    stated, wide = priors
    nowhere = np.zeros(len(score))
    log_odds = float(np.log(WRONG_FRACTION / (1 - WRONG_FRACTION)))
    log_odds += _log_marginal(score, information, offset, wide)
    return float(expit(log_odds - _log_marginal(score, information, nowhere, stated)))


def _log_marginal(score: Array, information: Array, mean: Array, covariance: Array) -> float:
    """Log marginal likelihood of the strikes for normal radii, up to a constant that all priors share.

    Args:
        score: (n,) derivative of the log likelihood by the radii, at those that `mean` counts from [1/m].
        information: (n, n) minus the second derivative of the log likelihood [1/m^2].
        mean: (n,) mean of the radii's prior, from the same point [m].
        covariance: (n, n) covariance of that prior [m^2].
    """
    there = score - information @ mean
    grown = np.eye(len(score)) + information @ covariance
    gained = there @ covariance @ np.linalg.solve(grown, there) - np.linalg.slogdet(grown)[1]
    return float(score @ mean - 0.5 * mean @ information @ mean + 0.5 * gained)
