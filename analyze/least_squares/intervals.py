"""Factor from a standard deviation to the half-width of a 95 % interval."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import stdtrit

if TYPE_CHECKING:
    from analyze.types import Array

SIGMAS_95 = 1.96
"""Half-width of a normal variable's 95 % interval, in standard deviations."""


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
