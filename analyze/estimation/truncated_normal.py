"""Truncated normal distributions: between two bounds, and of three non-negative shares of a whole."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, ndtri_exp

from analyze.types import Array

GRID_POINTS = 17, 17, 25
"""Numbers of grid points of the first share: over [0, 1], about the highest density, over the support that
counts."""
EQUAL_LENGTH_TOLERANCE = 0.03
"""Relative difference in length below which intervals of draws count as equally long."""
NEGLIGIBLE_LOG_DENSITY = 16.0
"""Fall of the log density from its peak beyond which it is neglected."""


def draw_truncated(mean: Array, sd: Array, low: Array, high: Array, rng: np.random.Generator) -> Array:
    """One random value (n,) from each of n normal distributions truncated to [low, high].

    Args:
        mean: (n,) means before truncation.
        sd: (n,) standard deviations before truncation.
        low: (n,) lower bounds.
        high: (n,) upper bounds.
        rng: Random generator.

    Returns:
        (n,) values, each within its bounds.
    """
    from_, to = (low - mean) / sd, (high - mean) / sd
    # In the lower tail the logarithm of the distribution function keeps its precision.
    flip = from_ + to > 0
    near, far = np.where(flip, -to, from_), np.where(flip, -from_, to)
    log_far = log_ndtr(far)
    share = rng.uniform(size=mean.shape)
    drawn = ndtri_exp(
        log_far + np.log(share + (1.0 - share) * np.exp(np.minimum(log_ndtr(near) - log_far, 0.0)))
    )
    return np.minimum(np.maximum(mean + sd * np.where(flip, -drawn, drawn), low), high)


def narrowest_intervals(ordered: Array) -> tuple[Array, Array]:
    """Lower and upper ends, each (n,), of the shortest intervals with 95 % of the draws of n quantities.

    Each column of `ordered` (m, n) holds the m draws of one quantity in ascending order.
    """
    inside = math.ceil(0.95 * len(ordered))
    first = np.argmin(ordered[inside - 1 :] - ordered[: len(ordered) - inside + 1], axis=0)
    columns = np.arange(ordered.shape[1])
    return ordered[first, columns], ordered[first + inside - 1, columns]


def shortest_intervals(draws: Array, lowest: float) -> tuple[Array, Array]:
    """Lower and upper ends, each (n,), of the shortest intervals with 95 % of the draws of n quantities.

    Each column of `draws` (m, n) holds the m draws of one quantity. `lowest` is the lower bound of all
    quantities, which draws approach without reaching it: an interval that begins at the bound therefore
    replaces the shortest one if it is not longer by more than `EQUAL_LENGTH_TOLERANCE`.
    """
    ordered = np.sort(draws, axis=0)
    low, high = narrowest_intervals(ordered)
    from_bound = ordered[math.ceil(0.95 * len(ordered)) - 1]
    at_bound = from_bound - lowest <= (1 + EQUAL_LENGTH_TOLERANCE) * (high - low)
    return np.where(at_bound, lowest, low), np.where(at_bound, from_bound, high)


def log_normal_mass(low: Array, high: Array) -> Array:
    """Natural log of the probability (...) of a standard normal variable to lie between `low` and `high`.

    It is precise in the tails. `low` and `high` (...) are broadcast to one shape, which the result has.
    """
    flip = low + high > 0
    near, far = np.where(flip, -high, low), np.where(flip, -low, high)
    log_far = log_ndtr(far)
    with np.errstate(divide="ignore"):
        return log_far + np.log1p(-np.exp(np.minimum(log_ndtr(near) - log_far, 0.0)))


EMPTY_PART_PRIOR = (0.25, 0.25)
"""Prior probabilities that the second share is zero, and the third: most containers have air on one side of a
filling."""


@dataclass(frozen=True)
class ShareDistribution:
    """Set of b posterior distributions of three shares (u, v, 1 - u - v) of a whole, none negative.

    The likelihood is normal in w = (u, v), the first two shares. The prior gives probability
    `EMPTY_PART_PRIOR` to the second share being zero, and to the third. Otherwise it is uniform: over all
    possible shares (a triangle), or over those with one of the two zero (two sides of the triangle). The
    marginal density of u is tabulated on a grid that covers its support.
    """

    mean: Array
    """(b, 2) means before truncation."""
    precision: Array
    """(b, 2, 2) inverse covariances before truncation."""
    places: Array
    """(b, nodes) evenly spaced grid of u."""
    log_density: Array
    """(b, nodes) log marginal density of u at `places`: exp(-(w - mean).precision.(w - mean) / 2) integrated
    over v from 0 to 1 - u."""

    @property
    def log_mass(self) -> Array:
        """Log (b,) of the integral of prior times likelihood of each of b distributions.

        A distribution is over three shares of a whole, none negative; the integral is over all such shares.
        The prior gives probability `EMPTY_PART_PRIOR` to the second share being zero, and to the third;
        otherwise it is uniform.
        With w the first two shares, and their mean and precision (inverse covariance) before truncation, the
        likelihood is exp(-(w - mean).precision.(w - mean) / 2).
        """
        return np.logaddexp.reduce(self._log_parts, axis=0)

    @property
    def _log_parts(self) -> Array:
        """Log (3, b) of the unnormalised probability of three cases, for each of b distributions.

        Each distribution is over three shares of a whole, which add up to 1. The cases are, in this order: no
        share is 0, the second is 0, the third is 0. The probability is the integral of
        prior times likelihood over the case.
        """
        top = self.log_density.max(axis=1)
        step = self.places[:, 1] - self.places[:, 0]
        weight = np.exp(self.log_density - top[:, None])
        weight[:, [0, -1]] *= 0.5
        # The triangle's area is a half.
        inside = np.log(2 * (1 - sum(EMPTY_PART_PRIOR))) + top + np.log(weight.sum(axis=1) * step)
        on_sides = np.log(EMPTY_PART_PRIOR)[:, None] + [side.log_mass for side in self._sides]
        return np.vstack([inside, on_sides])

    @property
    def _sides(self) -> tuple[_Side, _Side]:
        """Distributions of the first of three shares, u, if the second is 0, then those if the third is 0.

        Each case holds mean, sd and log density at the mean, (b,) each, of b normal distributions before
        truncation. The three shares add up to 1: with v the second, the possible (u, v) form a triangle, and
        the two cases are its sides v = 0 and v = 1 - u.
        """
        return _Side.on_line(self, np.array([0.0, 0.0]), np.array([1.0, 0.0])), _Side.on_line(
            self, np.array([0.0, 1.0]), np.array([1.0, -1.0])
        )

    def draw(self, rng: np.random.Generator) -> Array:
        """One random set of three shares (b, 3) of a whole from each of the b distributions.

        The shares of a set add up to 1 and none is negative; the second or the third may be exactly zero.
        """
        parts = self._log_parts
        kind = np.argmax(parts + rng.gumbel(size=parts.shape), axis=0)
        second_empty, third_empty = (side.draw(rng) for side in self._sides)
        nothing = np.zeros(len(kind))
        kinds = [
            self._draw_inside(rng),
            np.stack([second_empty, nothing, 1.0 - second_empty], axis=1),
            np.stack([third_empty, 1.0 - third_empty, nothing], axis=1),
        ]
        return np.choose(kind[:, None], kinds)

    def _draw_inside(self, rng: np.random.Generator) -> Array:
        """Random draws (b, 3), one per distribution: three shares of a whole, none of them zero."""
        density = np.exp(self.log_density - self.log_density.max(axis=1, keepdims=True))
        between = np.cumsum(density[:, 1:] + density[:, :-1], axis=1)
        level = rng.uniform(size=len(between)) * between[:, -1]
        cell = np.minimum(np.sum(between <= level[:, None], axis=1), between.shape[1] - 1)
        rows = np.arange(len(cell))
        first, last = density[rows, cell], density[rows, cell + 1]
        # Within a cell the density is linear from `first` to `last`: its distribution function is quadratic.
        rest = np.clip(level - np.where(cell > 0, between[rows, cell - 1], 0.0), 0.0, first + last)
        root = np.sqrt(np.maximum(first**2 + (last - first) * rest, 0.0))
        part = np.clip(rest / np.maximum(first + root, 1e-300), 0.0, 1.0)
        u = self.places[rows, cell] + part * (self.places[:, 1] - self.places[:, 0])
        middle, sd = _second_given_first(self.mean, self.precision, u[:, None])
        v = draw_truncated(middle[:, 0], sd, np.zeros(len(u)), 1.0 - u, rng)
        return np.stack([u, v, 1.0 - u - v], axis=1)


@dataclass(frozen=True)
class _Side:
    """Normal distributions of a share u, the first of three that add up to 1, while another one is zero.

    All possible shares form a triangle; those with the second (or the third) equal to 0 are one of its sides,
    on which u runs from 0 to 1. There are b distributions, truncated to that range.
    """

    mean: Array
    """(b,) means of u before truncation."""
    sd: Array
    """(b,) standard deviations of u before truncation."""
    log_peak: Array
    """(b,) log density at the mean, not normalised."""

    @classmethod
    def on_line(cls, shares: ShareDistribution, start: Array, along: Array) -> _Side:
        """Normal distributions of u, the first of three shares, if the second or the third share is zero.

        The shares then lie on a side of the triangle of possible shares. Returned are, (b,) each, mean and
        sd of u before truncation to 0..1, and the logarithm of exp(-d.P.d / 2) at that mean: the density of
        the three shares, not normalised, with d = (u, v) - `shares.mean` and P = `shares.precision`.

        Args:
            shares: b distributions of three shares, before this condition.
            start: (2,) first and second share (u, v) at u = 0 on this side.
            along: (2,) change of (u, v) per unit of u: (u, v) = start + u along.
        """
        off = shares.mean - start
        towards = np.einsum("i,bij,bj->b", along, shares.precision, off)
        size = np.einsum("i,bij,j->b", along, shares.precision, along)
        mean = towards / size
        left = off - mean[:, None] * along
        return cls(mean, 1.0 / np.sqrt(size), -0.5 * np.einsum("bi,bij,bj->b", left, shares.precision, left))

    @property
    def log_mass(self) -> Array:
        """Logarithms (b,) of the integrals over u, from 0 to 1, of b normal densities.

        u is the first of three shares of a mass. The densities are not normalised: their peak is
        exp(`log_peak`).
        """
        return (
            self.log_peak
            + np.log(np.sqrt(2 * np.pi) * self.sd)
            + log_normal_mass(-self.mean / self.sd, (1.0 - self.mean) / self.sd)
        )

    def draw(self, rng: np.random.Generator) -> Array:
        """Random values (b,) of u, the first of three shares of a whole, one from each of b distributions.

        The distributions are normal, truncated to 0..1.
        """
        return draw_truncated(self.mean, self.sd, np.zeros(len(self.mean)), np.ones(len(self.mean)), rng)


def share_distribution(mean: Array, precision: Array) -> ShareDistribution:
    """Distributions of three shares of a whole, none negative, from a normal likelihood of the first two.

    The marginal density of the first share is tabulated on a grid. It is log-concave (the marginal of a
    log-concave density: Prekopa 1973), so that its peak lies beside the highest point of a coarse grid.

    Args:
        mean: (b, 2) means of the first two shares before truncation at zero.
        precision: (b, 2, 2) inverse covariances of the first two shares before truncation.

    Returns:
        Set of b distributions.
    """
    rows = np.arange(len(mean))
    grid = np.linspace(0.0, 1.0, GRID_POINTS[0])
    everywhere = np.broadcast_to(grid, (len(mean), GRID_POINTS[0]))
    coarse = _log_density(mean, precision, everywhere)
    best = np.argmax(coarse, axis=1)
    low, high = grid[np.maximum(best - 1, 0)], grid[np.minimum(best + 1, GRID_POINTS[0] - 1)]
    near = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, GRID_POINTS[1])
    fine = _log_density(mean, precision, near)
    places = np.concatenate([everywhere, near], axis=1)
    order = np.argsort(places, axis=1)
    places = np.take_along_axis(places, order, axis=1)
    counts = np.take_along_axis(np.concatenate([coarse, fine], axis=1), order, axis=1)
    counts = counts > counts.max(axis=1, keepdims=True) - NEGLIGIBLE_LOG_DENSITY
    first = np.maximum(np.argmax(counts, axis=1) - 1, 0)
    last = np.minimum(counts.shape[1] - np.argmax(counts[:, ::-1], axis=1), counts.shape[1] - 1)
    low, high = places[rows, first], places[rows, last]
    places = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, GRID_POINTS[2])
    return ShareDistribution(mean, precision, places, _log_density(mean, precision, places))


def _second_given_first(mean: Array, precision: Array, u: Array) -> tuple[Array, Array]:
    """Mean (b, n) and sd (b,) of the second of three shares of a whole, if the first is `u` (b, n).

    They are those of b normal distributions before truncation at 0. `mean` (b, 2) and `precision` (b, 2, 2),
    the inverse covariance, are those of the first two shares.
    """
    c = precision[:, 1, 1]
    return mean[:, 1, None] - (precision[:, 0, 1] / c)[:, None] * (u - mean[:, 0, None]), 1.0 / np.sqrt(c)


def _log_density(mean: Array, precision: Array, u: Array) -> Array:
    """Log marginal density (b, n), not normalised, of the first of three shares at `u` (b, n).

    The shares are not negative and have the sum 1. `mean` (b, 2) and `precision` (b, 2, 2), the inverse
    covariance, are those of the first two shares, in each of b distributions, before truncation at zero.
    """
    middle, sd = _second_given_first(mean, precision, u)
    alone = precision[:, 0, 0] - precision[:, 0, 1] ** 2 / precision[:, 1, 1]
    inside = log_normal_mass(-middle / sd[:, None], (1.0 - u - middle) / sd[:, None])
    return (
        -0.5 * alone[:, None] * (u - mean[:, 0, None]) ** 2
        + inside
        + np.log(np.sqrt(2 * np.pi) * sd)[:, None]
    )
