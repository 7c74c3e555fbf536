"""Repeatability and reproducibility of repeated results, and which group of them stands out (ISO 5725-2:2019)."""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from analyze.types import Array

OUTLIER = 0.01
"""chance at which a group's mean is an outlier by Mandel's h"""
LEAST_GROUPS = 3
"""below which no group can stand out from the others"""


@dataclass(frozen=True)
class Precision:
    """Of one quantity, in its unit. Groups were made under one set of conditions each."""

    mean: float
    """of the groups' means"""
    s_r: float | None
    """repeatability standard deviation, within groups; None where no group holds two results"""
    s_L: float | None
    """standard deviation between groups; None where there is one group, or s_r is not known"""
    s_R: float | None
    """reproducibility standard deviation, s_R^2 = s_L^2 + s_r^2; None where there is one group"""
    freedom_r: int
    """degrees of freedom of s_r"""
    freedom_R: int
    """of s_R: groups less one"""


def precision(groups: Sequence[Sequence[float]]) -> Precision:
    """One-way analysis of variance for groups of unequal size (ISO 5725-2, 7.4.5).

    Args:
        groups: results by group, none empty; at least one group.
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
    """How far each group's mean (p,) is off that of all, over their standard deviation (ISO 5725-2, 7.3.1); None for fewer than three."""
    values = np.array(means, dtype=np.float64)
    spread = float(np.std(values, ddof=1)) if len(values) >= LEAST_GROUPS else 0.0
    return (values - values.mean()) / spread if spread > 0 else None


def mandel_h_limit(groups: int, chance: float = OUTLIER) -> float:
    """Of |h| of one of so many groups, passed with this chance (ISO 5725-2, table A.1); 3 or more groups."""
    t = float(stdtrit(groups - 2, 1 - chance / 2))
    return (groups - 1) * t / math.sqrt(groups * (t**2 + groups - 2))
