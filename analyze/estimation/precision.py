"""Repeatability and reproducibility of repeated results, and outlying groups (ISO 5725-2:2019)."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from analyze.types import Array

OUTLIER_SIGNIFICANCE = 0.01
"""Significance level at which a group's mean is an outlier by Mandel's h."""
MIN_GROUPS = 3
"""Smallest number of groups for which Mandel's h is defined."""


@dataclass(frozen=True)
class Precision:
    """Repeatability and reproducibility of one quantity, in its unit, from groups of repeated results.

    Results of a group were obtained under equal conditions. Repeatability is the standard deviation of
    results within a group; reproducibility adds the variation between groups.
    """

    mean: float
    """Mean of the groups' means."""
    s_r: float | None
    """Repeatability standard deviation, within groups; None if no group has two results."""
    s_L: float | None
    """Standard deviation between groups; None if there is one group, or s_r is not known."""
    s_R: float | None
    """Reproducibility standard deviation, s_R^2 = s_L^2 + s_r^2, or that of the groups' means if s_r is not
    known; None if there is one group."""
    freedom_r: int
    """Degrees of freedom of s_r."""
    freedom_R: int
    """Degrees of freedom of s_R: number of groups minus one."""


def precision(groups: Sequence[Sequence[float]]) -> Precision:
    """Scatter of results within and between groups, by one-way analysis of variance (ISO 5725-2, 7.4.5).

    Args:
        groups: Results of each group; at least one group, none empty, of equal or unequal size.

    Returns:
        Mean of the groups' means; standard deviations within groups (repeatability), between them, and of
        both together (reproducibility), in the results' unit, with degrees of freedom. A standard deviation
        is None where the groups are too few or too small for it.
    """
    sizes = np.array([len(group) for group in groups], dtype=np.float64)
    means = np.array([np.mean(group) for group in groups])
    within = sum(float(np.sum((np.array(group) - np.mean(group)) ** 2)) for group in groups)
    freedom_r, p = int(sizes.sum()) - len(groups), len(groups)
    s_r = math.sqrt(within / freedom_r) if freedom_r else None
    mean = float(means.mean())
    if p == 1:
        return Precision(mean, s_r, None, None, freedom_r, 0)
    if s_r is None:
        return Precision(mean, None, None, float(np.std(means, ddof=1)), 0, p - 1)
    grand = float(sizes @ means) / float(sizes.sum())
    between = float(sizes @ (means - grand) ** 2) / (p - 1)
    usual = (float(sizes.sum()) - float(sizes @ sizes) / float(sizes.sum())) / (p - 1)
    s_L = math.sqrt(max((between - s_r**2) / usual, 0.0))
    return Precision(mean, s_r, s_L, math.hypot(s_L, s_r), freedom_r, p - 1)


def mandel_h(means: Sequence[float]) -> Array | None:
    """Mandel's h (p,): deviation of p groups' means from their mean, over their sd (ISO 5725-2, 7.3.1).

    Args:
        means: Mean of each of the p groups.

    Returns:
        h in the groups' order; None for fewer than three groups, or equal means.
    """
    values = np.array(means, dtype=np.float64)
    spread = float(np.std(values, ddof=1)) if len(values) >= MIN_GROUPS else 0.0
    return (values - values.mean()) / spread if spread > 0 else None


def mandel_h_limit(groups: int, chance: float = OUTLIER_SIGNIFICANCE) -> float:
    """Critical value of abs(h), Mandel's h, at significance `chance` (ISO 5725-2, table A.1).

    h is the deviation of a group's mean from the mean of all means, over their standard deviation. `groups`
    is the number of groups, at least three.
    """
    t = float(stdtrit(groups - 2, 1 - chance / 2))
    return (groups - 1) * t / math.sqrt(groups * (t**2 + groups - 2))
