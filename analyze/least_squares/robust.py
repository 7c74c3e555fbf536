"""Robust weights, robust scale, and the correlation of residuals from sample to sample."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analyze.types import Array

NORMAL_MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""
MAX_CORRELATION = 0.9
"""Upper bound of an estimated lag-one correlation; near 1 the variance inflation would diverge."""


def median_scale(residual: Array) -> float:
    """Robust standard deviation of `residual` (n,), in its unit: 1.4826 times the median absolute value."""
    return NORMAL_MAD * float(np.median(np.abs(residual)))


def huber_weights(distance: Array, threshold: float, scale: float = 1.0) -> Array:
    """Weights w (n,) in 0..1 of Huber's loss: w = min(1, threshold * scale / abs(distance)).

    Source: Huber 1964, "Robust estimation of a location parameter".

    Args:
        distance: (n,) residuals, or norms of residual vectors.
        threshold: multiple of `scale` above which a residual has a weight below 1.
        scale: standard deviation of `distance`.
    """
    return np.minimum(1.0, threshold * scale / np.maximum(np.abs(distance), 1e-9))


def lag_one_correlation(standardised: Array) -> float:
    """Correlation a, from 0 to 0.9, of neighbouring values in a sequence of standardised residuals (n,).

    A measured correlation below 2 / sqrt(n), its noise, counts as 0, and so does a negative one: the
    residuals of a fit of p parameters to white noise have a correlation near -p / n, which must not reduce a
    variance.
    """
    power = max(float(np.sum(standardised * standardised)), 1e-30)
    correlation = float(np.sum(standardised[1:] * standardised[:-1])) / power
    return 0.0 if correlation < 2.0 / math.sqrt(len(standardised)) else min(correlation, MAX_CORRELATION)


def correlation_factor(standardised: Array) -> float:
    """Factor (1 + a) / (1 - a) on the variance of a mean of residuals (n,) with lag-one correlation a.

    a is the correlation of neighbouring residuals. The factor is 1 if a is below 2 / sqrt(n), its noise, and
    at most 19, for a = 0.9.
    """
    correlation = lag_one_correlation(standardised)
    return (1.0 + correlation) / (1.0 - correlation)
