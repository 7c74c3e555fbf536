"""Probability that a statement of edge radii is wrong, by the strikes' own information on the radii."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import softmax

from analyze.geometry.edge_radius import MAX_ASSUMED_RADIUS
from analyze.types import Array

WRONG_FRACTION = 0.1
"""Probability, before any strike, that a stated radius is wrong and says nothing about any edge."""
WRONG_ALIKE_FRACTION = 0.1
"""Probability, before any strike, that a stated radius is wrong and the edges are as alike as stated: 1.0 ±
0.1 mm where all are 0.3 mm, by a slip of pen or gauge."""
ALIKE_SD = MAX_ASSUMED_RADIUS / math.sqrt(12)
"""Sd [m] of the radius of edges that are all alike, where none is given."""


@dataclass(frozen=True)
class WrongOdds:
    """Probabilities that a statement of edge radii is wrong, given the strikes."""

    any: float = 0.0
    """probability that the edges are like those of any object"""
    alike: float = 0.0
    """probability that the edges are as alike as stated, about another mean"""


NOT_WRONG = WrongOdds()
"""A statement that is right."""


def probability_wrong(
    score: Array, information: Array, priors: tuple[Array, Array], offset: Array
) -> WrongOdds:
    """Probabilities that stated radii of n edges are wrong.

    The odds are those before the strikes (`WRONG_FRACTION`, `WRONG_ALIKE_FRACTION`) times the ratio of the
    strikes' marginal likelihoods: with radii about the stated ones, with those assumed where none is given,
    and with these but differing no more than stated.

    Args:
        score: (n,) derivative of the strikes' log likelihood by the radii, at the stated ones [1/m].
        information: (n, n) the strikes' own information (inverse covariance) on the radii [1/m^2].
        priors: (n, n) covariances [m^2] of the stated radii, and of radii that are not given.
        offset: (n,) mean of radii that are not given, minus the stated ones [m].
    """
    stated, wide = priors
    # The least covariance of two edges is that of the error which all of them share.
    alike = stated + max(ALIKE_SD**2 - float(stated.min()), 0.0)
    right = 1 - WRONG_FRACTION - WRONG_ALIKE_FRACTION
    log_odds = np.log([right, WRONG_FRACTION, WRONG_ALIKE_FRACTION]) + [
        _log_marginal(score, information, mean, covariance)
        for mean, covariance in ((np.zeros(len(score)), stated), (offset, wide), (offset, alike))
    ]
    _, anyhow, alike_wrong = softmax(log_odds)
    return WrongOdds(float(anyhow), float(alike_wrong))


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
