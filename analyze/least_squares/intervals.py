"""95 % intervals from standard deviations, also from those that are uncertain."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr, stdtrit

if TYPE_CHECKING:
    from analyze.types import Array

SIGMAS_95 = 1.96
"""Half-width of a normal variable's 95 % interval, in standard deviations."""
TAIL_95 = 0.025
"""Probability below a 95 % interval."""
QUANTILE_STEPS = 30
"""Number of bisections for a quantile."""


def student_sigmas_95(freedom: Array) -> Array:
    """Half-widths (k,) of 95 % intervals, as multiples of standard deviations estimated from data.

    They are the 97.5 % quantiles of Student's t distribution; 1.96 for infinite freedom.

    Args:
        freedom: (k,) degrees of freedom of the estimated variances.
    """
    return np.asarray(stdtrit(np.minimum(freedom, 1e9), 0.975), dtype=np.float64)


def pooled_freedom(variances: Array, freedoms: Array) -> Array:
    """Degrees of freedom (k,) of sums of independent variance estimates (Welch 1947, Satterthwaite 1946).

    Args:
        variances: (m, k) the variances that are added.
        freedoms: (m, k) degrees of freedom of each; inf where a variance is known.
    """
    total = np.sum(variances, axis=0)
    spread = np.sum(variances**2 / freedoms, axis=0)
    return np.asarray(total**2 / np.maximum(spread, 1e-300), dtype=np.float64)


def normal_sd(sds: Array, probability: Array) -> float:
    """Sd of the normal error with the 95 % interval of an error whose sd is uncertain.

    Args:
        sds: (n,) possible standard deviations, ascending, in any unit.
        probability: (n,) their probabilities.
    """
    low, high = float(sds[0]), float(sds[-1])
    for _ in range(QUANTILE_STEPS):
        middle = float(np.sqrt(low * high))
        tail = float(probability @ ndtr(-SIGMAS_95 * middle / sds))
        low, high = (low, middle) if tail < TAIL_95 else (middle, high)
    return high
