"""Covariance of a fit to few groups whose residuals share errors, with its degrees of freedom."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analyze.types import Array

_MIN_UNSHARED = 1e-3
"""Share of the information about a quantity that other groups must at least have."""


def jackknife_covariance(without: Array) -> Array:
    """Covariance (p, p) of p estimates from those without each of g groups in turn.

    It is (g - 1) / g times the sum of squares of the deviations from their mean (Tukey 1958): residuals of a
    group may be correlated in any way, and groups of large leverage are not underestimated, as they are where
    the fit's own residuals are used (Bell and McCaffrey 2002, estimator CR3).

    Args:
        without: (g, p) estimates without each group.
    """
    deviation = without - without.mean(axis=0)
    return deviation.T @ deviation * (len(without) - 1) / len(without)


def grouped_covariance(normal: Array, normals: Array, scores: Array) -> Array:
    """Covariance (p, p) of p estimates whose residuals share errors within groups.

    A fit draws its residuals towards zero, the more the larger a group's share of the information is; each
    group's score is scaled up for it (Bell and McCaffrey 2002, Survey Methodology 28, estimator CR2), so
    that the covariance is unbiased also for few groups.

    Args:
        normal: (p, p) normal matrix of the whole fit, in any unit.
        normals: (g, p, p) the groups' own contributions to it.
        scores: (g, p) gradient of each group's half sum of squares at the estimates.
    """
    values, vectors = np.linalg.eigh(normal)
    root = (vectors / np.sqrt(values)) @ vectors.T
    share, axes = np.linalg.eigh(root @ normals @ root)
    scale = 1.0 / np.sqrt(np.maximum(1.0 - share, _MIN_UNSHARED))
    turned = np.einsum("gji,jk,gk->gi", axes, root, scores) * scale
    steps = np.einsum("ij,gjk,gk->gi", root, axes, turned)
    return np.asarray(steps.T @ steps, dtype=np.float64)


def group_freedom(inverse: Array, normals: Array) -> Array:
    """Degrees of freedom (p,) of the variance of each of p estimates, from the information of each group.

    The variance estimate is a sum of one square per group; if a group's share of it is as its share of the
    information, the sum has (sum of shares)^2 / (sum of squared shares) degrees of freedom (Satterthwaite
    1946), of which the estimate itself takes one. At least 1.

    Args:
        inverse: (p, p) inverse of the normal matrix, in any unit.
        normals: (g, p, p) the groups' own contributions to the normal matrix, in the same unit.
    """
    share = np.einsum("jr,grc,cj->gj", inverse, normals, inverse)
    share = np.maximum(share, 0.0)
    total = share.sum(axis=0)
    return np.maximum(total**2 / np.maximum(np.sum(share**2, axis=0), 1e-300) - 1.0, 1.0)
