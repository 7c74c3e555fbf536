"""Covariance of a fit to few groups whose residuals share errors, with its degrees of freedom."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analyze.types import Array

_MIN_UNSHARED = 1e-3
"""Smallest share of the information about a quantity that is attributed to the other groups, to bound a
group's errors."""


def jackknife_covariance(without: Array) -> Array:
    """Covariance (p, p) of p estimates, from the estimates made without each of g groups of data in turn.

    It is (g - 1) / g times the sum of squares of the deviations from their mean (Tukey 1958): residuals of a
    group may be correlated in any way, and groups of large leverage are not underestimated, as they are where
    the fit's own residuals are used (Bell and McCaffrey 2002, estimator CR3).

    Args:
        without: (g, p) estimates without each group.
    """
    deviation = without - without.mean(axis=0)
    return deviation.T @ deviation * (len(without) - 1) / len(without)


def grouped_covariance(normal: Array, normals: Array, scores: Array) -> Array:
    """Covariance (p, p) of p least-squares estimates, where residuals of a group of data share errors.

    A fit draws its residuals towards zero, the more the larger a group's share of the information is. Each
    group's score (gradient of its part of the cost) is scaled up for it, so that the covariance is unbiased
    also for few groups (Bell and McCaffrey 2002, Survey Methodology 28, estimator CR2).

    Args:
        normal: (p, p) normal matrix J^T W J of the whole fit, J being the residuals' derivatives by the
            parameters, W their weights. A common factor of all three arguments changes nothing.
        normals: (g, p, p) the groups' own contributions to it.
        scores: (g, p) gradient of each group's half weighted sum of squares at the estimates.
    """
    values, vectors = np.linalg.eigh(normal)
    root = (vectors / np.sqrt(values)) @ vectors.T
    share, axes = np.linalg.eigh(root @ normals @ root)
    scale = 1.0 / np.sqrt(np.maximum(1.0 - share, _MIN_UNSHARED))
    turned = np.einsum("gji,jk,gk->gi", axes, root, scores) * scale
    steps = np.einsum("ij,gjk,gk->gi", root, axes, turned)
    return np.asarray(steps.T @ steps, dtype=np.float64)


def group_freedom(inverse: Array, normals: Array) -> Array:
    """Degrees of freedom (p,) of the variances of p estimates that are computed from g groups of data.

    A variance estimate is a sum of one square per group. If the groups have the same shares of it as of the
    information, it has (sum of shares)^2 / (sum of squared shares) degrees of freedom (Satterthwaite 1946),
    less one for the estimate itself; at least 1.

    Args:
        inverse: (p, q) inverse of the fit's normal matrix J^T W J, in any unit; or, for p quantities that
            depend on its q unknowns, their derivatives times that inverse.
        normals: (g, q, q) the groups' own contributions to the normal matrix, in the same unit.
    """
    share = np.einsum("jr,grc,jc->gj", inverse, normals, inverse)
    share = np.maximum(share, 0.0)
    total = share.sum(axis=0)
    return np.maximum(total**2 / np.maximum(np.sum(share**2, axis=0), 1e-300) - 1.0, 1.0)
