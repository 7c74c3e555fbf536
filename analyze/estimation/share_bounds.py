"""Extremes of linear functions of mass shares whose moments agree with measured ones.

The shares x of n pieces are non-negative, bounded by `most`, and add up to 1; the k whitened moments A x may
differ from the measured ones t by at most r: |A x - t| <= r. By Lagrangian duality the least value of c.x is

    max over w > 0 of  min over x of  c.x + w / 2 (|A x - t|^2 - r^2),

and any w gives a lower bound. The inner minimum is a quadratic programme (primal-dual interior-point method,
Boyd and Vandenberghe 2004, section 11.7, with the corrector of Mehrotra 1992) whose Newton systems are of
size k + 1 only. Where it stops early, the bounds still hold, and are only less tight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.types import Array

WEIGHT_UPDATES = 6
"""Number of times that the weight w of the moments is improved."""
MAX_STEPS = 50
"""Largest number of Newton steps of a quadratic programme."""
SHARE_GAP, CHI2_GAP = 3e-4, 0.01
"""Duality gaps at which a quadratic programme is solved: of a share of the mass, and of chi^2 / 2."""
_START_WEIGHT = 0.02
"""First weight w of the moments: chi^2 / 2 counts as 0.02 of the body's mass."""
_RIDGE = 1e-14
"""Added to the unit diagonal of a matrix before it is inverted."""
_MAX_WEIGHT_FACTOR = 10.0
"""Largest factor by which w changes in one update."""
_CENTRING = 0.1
"""Smallest duality gap that a Newton step aims at, over the gap at which the iteration stops."""
_BOUNDARY_FRACTION = 0.99
"""Largest step, as a fraction of that to the nearest bound."""


@dataclass(frozen=True)
class SharePolytope:
    """All mass shares of n pieces of a body that are possible, and k moments that they should explain.

    Shares are at least 0, at most `most`, and of sum 1. The moments are whitened: scaled so that the measured
    ones have independent errors of unit sd.
    """

    explaining: Array
    """(k, n) whitened moments that the body would have if all its mass were in one piece."""
    target: Array
    """(k,) measured moments, whitened likewise."""
    most: Array
    """(n,) largest share of each piece; their sum is above 1."""

    def least_chi2(self) -> float:
        """Smallest chi^2 of any possible shares: squared distance of their moments from the measured ones."""
        x = self._minimised(np.zeros((1, len(self.most))), np.ones(1), CHI2_GAP)[0]
        return float(np.sum((self.explaining @ x - self.target) ** 2))

    def minima(self, costs: Array, radius: float) -> Array:
        """Lower bounds (b,) of b linear functions of the shares, about 0.001 below their minima.

        The minima are over all possible shares whose moments are at most `radius` from the measured ones.

        Args:
            costs: (b, n) coefficients of the functions.
            radius: Largest distance of the whitened moments from the measured ones; above the least possible.
        """
        weight, best = np.full(len(costs), _START_WEIGHT), np.min(costs, axis=1)
        for _ in range(WEIGHT_UPDATES):
            x = self._minimised(costs, weight, SHARE_GAP)
            off = x @ self.explaining.T - self.target
            distance = np.sqrt(np.sum(off**2, axis=1))
            # The Lagrangian is convex in x: its tangent plane at x bounds it from below, and a linear
            # function of the shares is least where the cheapest pieces are filled first.
            slope = costs + weight[:, None] * (off @ self.explaining)
            value = np.sum((costs - slope) * x, axis=1) + weight / 2 * (distance**2 - radius**2)
            best = np.maximum(best, value + self._cheapest(slope))
            # x itself is allowed, and its value as good as the bound.
            if np.all((distance <= 1.01 * radius) & (np.sum(costs * x, axis=1) - best < 6 * SHARE_GAP)):
                break
            # Exact where the least value is linear in r.
            weight = weight * np.clip(distance / radius, 1 / _MAX_WEIGHT_FACTOR, _MAX_WEIGHT_FACTOR)
        return best

    def _cheapest(self, costs: Array) -> Array:
        """Least values (b,) of b linear functions over all possible shares, whatever their moments.

        `costs` (b, n) are the functions' coefficients.
        """
        order = np.argsort(costs, axis=1)
        cost, most = np.take_along_axis(costs, order, axis=1), self.most[order]
        before = np.cumsum(most, axis=1) - most
        return np.sum(cost * np.clip(1.0 - before, 0.0, most), axis=1)

    def _minimised(self, costs: Array, weight: Array, least_gap: float) -> Array:
        """Possible shares x (b, n) that minimise costs.x + w / 2 |A x - t|^2, for b rows of `costs` (b, n).

        A x are the moments of the shares (`explaining`), t the measured ones (`target`); `weight` (b,) is w.
        The iteration stops at the duality gap `least_gap` (bound of how far the value is above its minimum).
        """
        # The sum of x is 1: A x - t = (A - t 1') x, which keeps the equations better conditioned.
        A, most, constraints = self.explaining - self.target[:, None], self.most, 2 * costs.shape[1]
        rows = np.vstack([A, np.ones((1, len(most)))])
        softness = np.zeros((len(costs), len(rows), len(rows)))
        softness[:, :-1, :-1] = np.eye(len(A)) / weight[:, None, None]
        x: Array = np.tile(most / most.sum(), (len(costs), 1))
        slope: Array = costs + weight[:, None] * (x @ A.T @ A)
        # Multipliers that make the Lagrangian stationary: so it stays, and the gap bounds the error.
        high: Array = np.tile(1e-12 + np.ptp(slope, axis=1, keepdims=True), (1, len(most)))
        low: Array = slope - slope.min(axis=1, keepdims=True) + high
        for _ in range(MAX_STEPS):
            above = most - x
            gap: Array = np.sum(low * x + high * above, axis=1)
            # A problem that is solved stays where it is: its equations are the worst conditioned.
            unsolved = gap > least_gap
            if not unsolved.any():
                break
            slope = costs + weight[:, None] * (x @ A.T @ A)
            loose = 1 / (low / x + high / above)
            scaled = rows * loose[:, None, :]
            inverse = _scaled_inverse(scaled @ rows.T + softness)
            # Mehrotra's method: a step that aims at no gap shows how far to aim, and its curvature.
            aim_low, aim_high = np.zeros_like(x), np.zeros_like(x)
            step, low_step, high_step, size = x, low, high, gap[:, None]
            for corrector in (False, True):
                right: Array = aim_low / x - aim_high / above - slope
                lifted: Array = inverse @ (scaled @ right[..., None])
                step = loose * (right - lifted[..., 0] @ rows)
                low_step = (aim_low - low * step) / x - low
                high_step = (aim_high + high * step) / above - high
                size = _largest_step((x, above, low, high), (step, -step, low_step, high_step))[:, None]
                if not corrector:
                    left = (low + size * low_step) * (x + size * step)
                    left += (high + size * high_step) * (above - size * step)
                    wanted = gap * (left.sum(axis=1) / gap) ** 3
                    aim = np.maximum(wanted, _CENTRING * least_gap)[:, None] / constraints
                    aim_low, aim_high = aim - low_step * step, aim + high_step * step
            x_next, low_next, high_next = x + size * step, low + size * low_step, high + size * high_step
            # False for values that are not numbers, too.
            inside = (np.minimum(x_next, most - x_next) > 0) & (np.minimum(low_next, high_next) > 0)
            moved = (unsolved & np.all(inside, axis=1))[:, None]
            if not moved.any():
                break
            x, low, high = (
                np.where(moved, new, old) for new, old in ((x_next, x), (low_next, low), (high_next, high))
            )
        return x / x.sum(axis=1, keepdims=True)


def _scaled_inverse(matrices: Array) -> Array:
    """Inverses (b, k, k) of b symmetric positive definite matrices, scaled to a unit diagonal in between.

    Their rows differ in size by orders of magnitude, by which the inverse would lose precision.
    """
    unit: Array = 1 / np.sqrt(np.diagonal(matrices, axis1=1, axis2=2))
    both = unit[:, :, None] * unit[:, None, :]
    inverse = np.linalg.inv(both * matrices + _RIDGE * np.eye(matrices.shape[-1]))
    return np.asarray(both * inverse, dtype=np.float64)


def _largest_step(values: Sequence[Array], steps: Sequence[Array]) -> Array:
    """Sizes (b,) of a step, at most 1, in b problems, such that all their positive values stay positive.

    `values` are arrays (b, n), all positive; `steps` are their changes by a step of size 1. The size is at
    most the fraction `_BOUNDARY_FRACTION` of that at which the first value would be 0.
    """
    fall = np.max(-np.hstack(list(steps)) / np.hstack(list(values)), axis=1)
    return np.minimum(1.0, _BOUNDARY_FRACTION / np.maximum(fall, 1e-12))
