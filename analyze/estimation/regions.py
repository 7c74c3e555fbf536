"""Masses of the shell and of the interior on either side of a plane (METHOD section 6, "ours")."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.estimation.cells import Cells
from analyze.estimation.cut_normal import shortest
from analyze.estimation.region_limits import region_limits
from analyze.estimation.region_problem import Borders, RegionProblem
from analyze.types import Array, InertialParameters, IntArray, MassDistribution

NAMES = ("surface", "upper", "lower")
FIRST_LOOK = 3000
CHAINS = 200
WARM_STEPS, KEPT_STEPS = 12, 10
WARMEST = 10.0
"""temperature of the posterior at first, so that the chains find all its valleys"""
ALONG_OTHERS = 0.5
"""share of the moves along the difference of two other chains, which knows how wide the valley is (ter Braak 2006)"""
SIZES = (0.02, 0.1, 0.3)
"""rad, of the other moves"""
REFUTED = 0.02
"""probability of a chi^2 as great as the best border's, from which on the body is no wall with two even parts inside"""
SIGMAS95 = 1.96


def mass_distribution(parameters: InertialParameters, cells: Cells, rng: np.random.Generator) -> MassDistribution:
    """Masses of three regions, each uniform: the shell (R1), the interior where n.x > offset (R2) and elsewhere (R3).

    The border is drawn in direction and offset by Metropolis chains from its posterior: a border counts by all shares of the mass that fit
    with it, not by the best ones alone. For each the shares are then drawn from their normal distribution, cut off where one is negative.
    n points to the same side as the body's longest direction.

    The intervals hold for such a body. Where even the best border leaves a misfit that is no error of measurement, the body is another one:
    then they are what any filling of an even wall leaves open.

    Args:
        parameters: mass, c, moments with their joint covariance.
        cells: the body.
        rng: for the chains; the same seed gives the same answer.
    """
    problem = RegionProblem(parameters, cells)
    chains = _posterior(problem, rng)
    borders = chains.borders
    best = int(np.argmax(chains.log_posterior))
    side = -1.0 if borders.normals[best] @ problem.longest < 0 else 1.0
    normal, height = side * borders.normals[best], side * float(borders.heights[best])
    # Upper is what the best border has above it, however close to level with it another one is.
    normals, heights = _on_side(borders.normals, borders.heights, normal)
    shares = borders.shares.draw(rng)
    misfit = float(borders.misfit(shares).min())
    shares = np.where((borders.normals @ normal < 0)[:, None], shares[:, [0, 2, 1]], shares)
    masses = shares * rng.normal(parameters.mass, parameters.mass_sd, len(shares))[:, None]
    middle = float(normal @ problem.middle)
    # Where each plane crosses the best one's normal through the middle.
    low, high = np.quantile(heights / np.maximum(normals @ normal, 0.2), [0.025, 0.975])
    limits = parameters.mass * region_limits(problem, normal, height)
    intervals, covariance = np.stack(shortest(masses, 0.0), axis=1), np.cov(masses.T)
    explained = problem.probability(misfit) >= REFUTED
    if not explained:
        mean = masses.mean(axis=0)
        intervals = np.stack([np.minimum(limits[:, 0], mean), np.maximum(limits[:, 1], mean)], axis=1)
        wider = np.maximum(1.0, np.ptp(intervals, axis=1) / (2 * SIGMAS95 * np.sqrt(np.maximum(np.diag(covariance), 1e-18))))
        covariance = covariance * np.outer(wider, wider)
    return MassDistribution(
        names=NAMES,
        masses=masses.mean(axis=0),
        covariance=covariance,
        intervals=intervals,
        limits=limits,
        misfit=misfit,
        explained=explained,
        border_normal=normal,
        border_offset=middle + height,
        border_offset_interval=(middle + float(min(low, height)), middle + float(max(high, height))),
        baselines=problem.baselines(parameters.mass, normal, height),
    )


@dataclass(frozen=True)
class _Chains:
    """Where Metropolis chains are, or were."""

    borders: Borders
    log_posterior: Array

    @classmethod
    def at(cls, borders: Borders) -> _Chains:
        """With the shares integrated out."""
        possible = np.where(borders.enough, borders.shares.log_mass - borders.chi_square / 2, -1e300)
        return cls(borders, possible)


def _posterior(problem: RegionProblem, rng: np.random.Generator) -> _Chains:
    """A look everywhere, then chains from where it fits well; they cool, so that all valleys are found and none is missed."""
    normals = _unit(rng.standard_normal((FIRST_LOOK, 3)))
    heights = rng.uniform(-0.5, 0.5, FIRST_LOOK) * problem.reach
    look = _Chains.at(problem.solve(normals, heights, coarsely=True))
    # n and -n are one plane: all on the likeliest one's side, so that differences of two mean something.
    near = normals[int(np.argmax(look.log_posterior))]
    chosen = _resampled(look.log_posterior / WARMEST, CHAINS, rng)
    chains = _Chains.at(problem.solve(*_on_side(normals[chosen], heights[chosen], near), coarsely=True))
    for step in range(WARM_STEPS):
        there = problem.solve(*_on_side(*_moved(chains.borders, problem.reach, rng), near), coarsely=True)
        chains = _stepped(chains, _Chains.at(there), WARMEST ** (1 - step / WARM_STEPS), rng)
    chains = _Chains.at(problem.solve(chains.borders.normals, chains.borders.heights))
    kept: list[_Chains] = []
    for _ in range(KEPT_STEPS):
        there = problem.solve(*_on_side(*_moved(chains.borders, problem.reach, rng), near))
        chains = _stepped(chains, _Chains.at(there), 1.0, rng)
        kept.append(chains)
    return _Chains(Borders.joined([each.borders for each in kept]), np.concatenate([each.log_posterior for each in kept]))


def _stepped(chains: _Chains, there: _Chains, temperature: float, rng: np.random.Generator) -> _Chains:
    """Each chain where it was or `there` (Metropolis)."""
    accept = there.log_posterior + temperature * rng.exponential(size=len(there.log_posterior)) > chains.log_posterior
    return _Chains(chains.borders.exchanged(accept, there.borders), np.where(accept, there.log_posterior, chains.log_posterior))


def _moved(borders: Borders, reach: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """A place beside each border, as likely as the way back: it turns about the middle of the body and shifts along itself."""
    many = len(borders.heights)
    size = rng.choice(SIZES, size=many)
    turn, shift = size[:, None] * rng.standard_normal((many, 3)), 0.3 * size * reach * rng.standard_normal(many)
    first, second = rng.integers(many, size=(2, many))
    along = rng.uniform(size=many) < ALONG_OTHERS
    turn = np.where(along[:, None], borders.normals[first] - borders.normals[second] + 0.05 * turn, turn)
    shift = np.where(along, borders.heights[first] - borders.heights[second] + 0.05 * shift, shift)
    return _unit(borders.normals + turn), borders.heights + shift


def _resampled(log_weight: Array, count: int, rng: np.random.Generator) -> IntArray:
    """Indices (count,), each as often as its weight says (systematic resampling)."""
    weight = np.exp(log_weight - log_weight.max())
    edges = np.cumsum(weight) / weight.sum()
    return np.minimum(np.searchsorted(edges, (np.arange(count) + rng.uniform()) / count), len(weight) - 1)


def _on_side(normals: Array, heights: Array, of: Array) -> tuple[Array, Array]:
    """The same planes, each with its normal on the side of `of` (3,)."""
    side = np.where(normals @ of < 0, -1.0, 1.0)
    return normals * side[:, None], heights * side


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
