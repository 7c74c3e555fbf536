"""Normal distributions cut off where masses cannot be: on a line between two bounds, and of three shares of a whole."""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, ndtri_exp

from analyze.types import Array

NODES = 17, 17, 25
"""of the first share: over all it may be, about the highest, over what counts"""
AS_SHORT = 0.03
"""relative: intervals drawn that differ in length by less are equally long"""
NOTHING = 16.0
"""natural logarithm by which a density may fall before it no longer counts"""


def draw_cut(mean: Array, sd: Array, low: Array, high: Array, rng: np.random.Generator) -> Array:
    """One draw each of normal distributions between bounds."""
    from_, to = (low - mean) / sd, (high - mean) / sd
    # In the lower tail, where logarithms of the distribution function tell all apart.
    flip = from_ + to > 0
    near, far = np.where(flip, -to, from_), np.where(flip, -from_, to)
    log_far = log_ndtr(far)
    share = rng.uniform(size=mean.shape)
    drawn = ndtri_exp(log_far + np.log(share + (1.0 - share) * np.exp(np.minimum(log_ndtr(near) - log_far, 0.0))))
    return np.clip(mean + sd * np.where(flip, -drawn, drawn), low, high)


def shortest(draws: Array, lowest: float) -> tuple[Array, Array]:
    """Ends (n,), (n,) of the shortest intervals that hold 95 % of `draws` (m, n), none of which can be below `lowest`.

    At that bound they begin there, where even tails would leave it out: draws come close, but do not reach it.
    """
    ordered = np.sort(draws, axis=0)
    inside = math.ceil(0.95 * len(ordered))
    first = np.argmin(ordered[inside - 1 :] - ordered[: len(ordered) - inside + 1], axis=0)
    columns = np.arange(draws.shape[1])
    low, high = ordered[first, columns], ordered[first + inside - 1, columns]
    from_bound = ordered[inside - 1]
    at_bound = from_bound - lowest <= (1 + AS_SHORT) * (high - low)
    return np.where(at_bound, lowest, low), np.where(at_bound, from_bound, high)


def log_between(low: Array, high: Array) -> Array:
    """Logarithm of the standard normal distribution's part between `low` and `high`, far out in its tails too."""
    flip = low + high > 0
    near, far = np.where(flip, -high, low), np.where(flip, -low, high)
    log_far = log_ndtr(far)
    with np.errstate(divide="ignore"):
        return log_far + np.log1p(-np.exp(np.minimum(log_ndtr(near) - log_far, 0.0)))


EMPTY = (0.25, 0.25)
"""prior probability that the second share is nothing, and that the third is: air on one side of a filling, as in most containers"""


@dataclass(frozen=True)
class Shares:
    """Normal distributions (b) of two shares (u, v) of a whole whose third is the rest, cut off where one of the three is negative.

    Beforehand the second share is nothing, or the third, with the probabilities EMPTY, and what is not nothing is spread evenly: over all
    shares that can be (a triangle), or over all that leave one of them nothing (two of its sides).
    The density of u with v integrated out is known at places that hold all of it.
    """

    mean: Array
    """(b, 2) without bounds"""
    precision: Array
    """(b, 2, 2)"""
    places: Array
    """(b, nodes) of u, evenly spaced"""
    log_density: Array
    """(b, nodes) there, for exp(-(w - mean).precision.(w - mean) / 2) in all"""

    @property
    def log_mass(self) -> Array:
        """(b,) logarithm of the prior's integral, times exp(-(w - mean).precision.(w - mean) / 2), over all possible shares."""
        return np.logaddexp.reduce(self._log_parts, axis=0)

    @property
    def _log_parts(self) -> Array:
        """(3, b) of that: nothing empty, the second share, the third."""
        top = self.log_density.max(axis=1)
        step = self.places[:, 1] - self.places[:, 0]
        weight = np.exp(self.log_density - top[:, None])
        weight[:, [0, -1]] *= 0.5
        # The triangle's area is a half.
        inside = np.log(2 * (1 - sum(EMPTY))) + top + np.log(weight.sum(axis=1) * step)
        return np.stack([inside, *(np.log(prior) + side.log_mass for prior, side in zip(EMPTY, self._sides, strict=True))])

    @property
    def _sides(self) -> tuple[_Side, _Side]:
        """Second share nothing: (u, 0). Third: (u, 1 - u)."""
        return _Side.of(self, np.array([0.0, 0.0]), np.array([1.0, 0.0])), _Side.of(self, np.array([0.0, 1.0]), np.array([1.0, -1.0]))

    def draw(self, rng: np.random.Generator) -> Array:
        """One draw (b, 3) each."""
        parts = self._log_parts
        kind = np.argmax(parts + rng.gumbel(size=parts.shape), axis=0)
        second_empty, third_empty = (side.draw(rng) for side in self._sides)
        nothing = np.zeros(len(kind))
        found = self._draw_inside(rng)
        found = np.where((kind == 1)[:, None], np.stack([second_empty, nothing, 1.0 - second_empty], axis=1), found)
        return np.where((kind == 2)[:, None], np.stack([third_empty, 1.0 - third_empty, nothing], axis=1), found)

    def _draw_inside(self, rng: np.random.Generator) -> Array:
        density = np.exp(self.log_density - self.log_density.max(axis=1, keepdims=True))
        between = np.cumsum(density[:, 1:] + density[:, :-1], axis=1)
        level = rng.uniform(size=len(between)) * between[:, -1]
        cell = np.minimum(np.sum(between <= level[:, None], axis=1), between.shape[1] - 1)
        rows = np.arange(len(cell))
        first, last = density[rows, cell], density[rows, cell + 1]
        # Within a cell the density runs straight from `first` to `last`: its distribution function is a quadratic.
        rest = np.clip(level - np.where(cell > 0, between[rows, cell - 1], 0.0), 0.0, first + last)
        root = np.sqrt(np.maximum(first**2 + (last - first) * rest, 0.0))
        part = np.clip(rest / np.maximum(first + root, 1e-300), 0.0, 1.0)
        u = self.places[rows, cell] + part * (self.places[:, 1] - self.places[:, 0])
        middle, sd = _second_given_first(self.mean, self.precision, u[:, None])
        v = draw_cut(middle[:, 0], sd, np.zeros(len(u)), 1.0 - u, rng)
        return np.stack([u, v, 1.0 - u - v], axis=1)


@dataclass(frozen=True)
class _Side:
    """The distributions on one side of the triangle, by the first share u."""

    mean: Array
    """(b,)"""
    sd: Array
    log_peak: Array
    """(b,) logarithm of the density at the mean"""

    @classmethod
    def of(cls, of: Shares, start: Array, along: Array) -> _Side:
        """(u, v) = start + u along, both (2,)."""
        off = of.mean - start
        towards = np.einsum("i,bij,bj->b", along, of.precision, off)
        size = np.einsum("i,bij,j->b", along, of.precision, along)
        mean = towards / size
        left = off - mean[:, None] * along
        return cls(mean, 1.0 / np.sqrt(size), -0.5 * np.einsum("bi,bij,bj->b", left, of.precision, left))

    @property
    def log_mass(self) -> Array:
        """(b,) logarithm of the integral from 0 to 1."""
        return self.log_peak + np.log(np.sqrt(2 * np.pi) * self.sd) + log_between(-self.mean / self.sd, (1.0 - self.mean) / self.sd)

    def draw(self, rng: np.random.Generator) -> Array:
        """(b,) of u."""
        return draw_cut(self.mean, self.sd, np.zeros(len(self.mean)), np.ones(len(self.mean)), rng)


def shares(mean: Array, precision: Array) -> Shares:
    """The distributions with (b, 2) and (b, 2, 2) when cut off.

    The density of u is log-concave (a marginal of such a one: Prekopa 1973), so that the highest of a few places has its peak beside it.
    """
    rows = np.arange(len(mean))
    grid = np.linspace(0.0, 1.0, NODES[0])
    everywhere = np.broadcast_to(grid, (len(mean), NODES[0]))
    coarse = _log_density(mean, precision, everywhere)
    best = np.argmax(coarse, axis=1)
    low, high = grid[np.maximum(best - 1, 0)], grid[np.minimum(best + 1, NODES[0] - 1)]
    near = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, NODES[1])
    fine = _log_density(mean, precision, near)
    places = np.concatenate([everywhere, near], axis=1)
    order = np.argsort(places, axis=1)
    places = np.take_along_axis(places, order, axis=1)
    counts = np.take_along_axis(np.concatenate([coarse, fine], axis=1), order, axis=1)
    counts = counts > counts.max(axis=1, keepdims=True) - NOTHING
    first = np.maximum(np.argmax(counts, axis=1) - 1, 0)
    last = np.minimum(counts.shape[1] - np.argmax(counts[:, ::-1], axis=1), counts.shape[1] - 1)
    low, high = places[rows, first], places[rows, last]
    places = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, NODES[2])
    return Shares(mean, precision, places, _log_density(mean, precision, places))


def _second_given_first(mean: Array, precision: Array, u: Array) -> tuple[Array, Array]:
    """Mean (b, n) and sd (b,) of v without bounds where the first share is `u` (b, n)."""
    c = precision[:, 1, 1]
    return mean[:, 1, None] - (precision[:, 0, 1] / c)[:, None] * (u - mean[:, 0, None]), 1.0 / np.sqrt(c)


def _log_density(mean: Array, precision: Array, u: Array) -> Array:
    middle, sd = _second_given_first(mean, precision, u)
    alone = precision[:, 0, 0] - precision[:, 0, 1] ** 2 / precision[:, 1, 1]
    inside = log_between(-middle / sd[:, None], (1.0 - u - middle) / sd[:, None])
    return -0.5 * alone[:, None] * (u - mean[:, 0, None]) ** 2 + inside + np.log(np.sqrt(2 * np.pi) * sd)[:, None]
