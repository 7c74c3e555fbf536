"""Masses of the shell and of the interior on either side of a plane (METHOD section 6, "ours")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.cells import Cells
from analyze.estimation.cut_normal import shortest
from analyze.estimation.region_limits import region_limits
from analyze.estimation.region_problem import Borders, RegionProblem
from analyze.types import Array, InertialParameters, IntArray, MassDistribution, WallThickness

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
LEAST_WEIGHT = 0.005
"""probability from which on a thickness of the wall counts"""
DRAWS = 4000
"""of the thickness"""


@dataclass(frozen=True)
class Wall:
    """The body cut into wall and interior, for one thickness of the wall."""

    thickness: float
    """m"""
    cells: Cells


def mass_distribution(parameters: InertialParameters, cells: Cells, rng: np.random.Generator) -> MassDistribution:
    """Masses of three regions, each uniform: the shell (R1), the interior where n.x > offset (R2) and elsewhere (R3).

    The border is drawn in direction and offset by Metropolis chains from its posterior: a border counts by all shares of the mass that fit
    with it, not by the best ones alone. For each the shares are then drawn from their normal distribution, cut off where one is negative.
    n points to the same side as the body's longest direction.

    The intervals hold for such a body. Where even the best border leaves a misfit that is no error of measurement, the body is another one:
    then its sides are those of its middle, across its longest direction, and the intervals what any filling of an even wall leaves open.

    Args:
        parameters: mass, c, moments with their joint covariance.
        cells: the body.
        rng: for the chains; the same seed gives the same answer.
    """
    return _distribution([_told(parameters, cells, rng)], np.ones(1), parameters, rng)


def mass_distribution_over(parameters: InertialParameters, walls: Sequence[Wall], rng: np.random.Generator) -> MassDistribution:
    """As `mass_distribution`, where the wall's thickness is not known: each of `walls` counts by its evidence.

    Args:
        parameters: mass, c, moments with their joint covariance.
        walls: at least two, their thicknesses rising by equal factors: each stands for those around it, all alike in the logarithm.
        rng: for the chains; the same seed gives the same answer.
    """
    told = [_told(parameters, wall.cells, rng) for wall in walls]
    evidence = np.array([each.log_evidence for each in told])
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    found = _distribution(told, weight, parameters, rng)
    logs = np.log([wall.thickness for wall in walls])
    step = float(logs[1] - logs[0])
    drawn = np.exp(rng.choice(logs, size=DRAWS, p=weight) + rng.uniform(-0.5, 0.5, DRAWS) * step)
    low, high = (float(end[0]) for end in shortest(drawn[:, None], 0.0))
    swept = (float(np.exp(logs[0] - step / 2)), float(np.exp(logs[-1] + step / 2)))
    return replace(found, wall=WallThickness(float(drawn.mean()), float(drawn.std()), (low, high), swept))


@dataclass(frozen=True)
class _Told:
    """What the moments say of borders, for one thickness of the wall."""

    problem: RegionProblem
    chains: _Chains
    log_evidence: float
    """of this wall, up to what all walls share"""
    draws: Array
    """(n, 3) kg, one per border"""
    misfit: float
    """chi^2 of the best of them"""


def _told(parameters: InertialParameters, cells: Cells, rng: np.random.Generator) -> _Told:
    problem = RegionProblem(parameters, cells)
    chains, log_evidence = _posterior(problem, rng)
    shares = chains.borders.shares.draw(rng)
    masses = shares * rng.normal(parameters.mass, parameters.mass_sd, len(shares))[:, None]
    return _Told(problem, chains, log_evidence, masses, float(chains.borders.misfit(shares).min()))


def _distribution(told: Sequence[_Told], weight: Array, parameters: InertialParameters, rng: np.random.Generator) -> MassDistribution:
    """Of walls that are as likely as `weight` (w,) says."""
    first = told[int(np.argmax(weight))]
    problem, borders = first.problem, first.chains.borders
    best = int(np.argmax(first.chains.log_posterior))
    side = -1.0 if borders.normals[best] @ problem.longest < 0 else 1.0
    normal, height = side * borders.normals[best], side * float(borders.heights[best])
    middle = float(normal @ problem.middle)
    counted = [(each, float(w)) for each, w in zip(told, weight, strict=True) if w >= LEAST_WEIGHT]
    masses, places = [np.concatenate(parts) for parts in zip(*(_drawn(each, w, normal, rng) for each, w in counted), strict=True)]
    low, high = np.quantile(places, [0.025, 0.975])
    ends = np.array([region_limits(each.problem, normal, middle + height - float(normal @ each.problem.middle)) for each, _ in counted])
    limits = parameters.mass * np.stack([ends[..., 0].min(axis=0), ends[..., 1].max(axis=0)], axis=1)
    intervals, covariance = np.stack(shortest(masses, 0.0), axis=1), np.cov(masses.T)
    misfit = min(each.misfit for each, _ in counted)
    if problem.probability(misfit) < REFUTED:
        return _of_another_body(told, weight, parameters, misfit)
    return MassDistribution(
        names=NAMES,
        masses=masses.mean(axis=0),
        covariance=covariance,
        intervals=intervals,
        limits=limits,
        misfit=misfit,
        explained=True,
        border_normal=normal,
        border_offset=middle + height,
        border_offset_interval=(middle + float(min(low, height)), middle + float(max(high, height))),
        baselines=problem.baselines(parameters.mass, normal, height),
    )


def _of_another_body(told: Sequence[_Told], weight: Array, parameters: InertialParameters, misfit: float) -> MassDistribution:
    """No border explains the moments: then none is told, and sides are those of the body's middle across its longest direction.

    The masses are the middle of what any filling of an even wall allows, moved to the right sum by the widths of these limits.
    """
    problem = told[int(np.argmax(weight))].problem
    ends = np.array([region_limits(each.problem, problem.longest, 0.0) for each, w in zip(told, weight, strict=True) if w >= LEAST_WEIGHT])
    limits = parameters.mass * np.stack([ends[..., 0].min(axis=0), ends[..., 1].max(axis=0)], axis=1)
    width, middle = np.ptp(limits, axis=1), limits.mean(axis=1)
    masses = middle + (parameters.mass - middle.sum()) * width / max(float(width.sum()), 1e-12)
    # As wide as an even distribution between the limits; of what one region has more, the others have less.
    sd = np.maximum(width, 1e-9 * parameters.mass) / np.sqrt(12)
    share = sd**2 / np.sum(sd**2)
    covariance = np.diag(sd**2) - np.sum(sd**2) * np.outer(share, share)
    across = float(problem.longest @ problem.middle)
    return MassDistribution(
        names=NAMES,
        masses=masses,
        covariance=covariance + np.outer(masses, masses) * (parameters.mass_sd / parameters.mass) ** 2,
        intervals=np.stack([np.minimum(limits[:, 0], masses), np.maximum(limits[:, 1], masses)], axis=1),
        limits=limits,
        misfit=misfit,
        explained=False,
        border_normal=problem.longest,
        border_offset=across,
        border_offset_interval=(across, across),
        baselines=problem.baselines(parameters.mass, problem.longest, 0.0),
    )


def _drawn(told: _Told, weight: float, normal: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Masses (n, 3) [kg] and where their borders cross the normal (3,) through the middle (n,) [m]; fewer of what is less likely."""
    borders = told.chains.borders
    # Upper is what the best border has above it, however close to level with it another one is.
    normals, heights = _on_side(borders.normals, borders.heights, normal)
    masses = np.where((borders.normals @ normal < 0)[:, None], told.draws[:, [0, 2, 1]], told.draws)
    places = heights / np.maximum(normals @ normal, 0.2)
    if weight == 1.0:
        return masses, places
    chosen = rng.choice(len(masses), size=max(1, round(weight * len(masses))), replace=False)
    return masses[chosen], places[chosen]


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


def _posterior(problem: RegionProblem, rng: np.random.Generator) -> tuple[_Chains, float]:
    """A look everywhere, then chains from where it fits well; they cool, so that all valleys are found and none is missed.

    The look's mean is the evidence, in its logarithm.
    """
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
    most = float(look.log_posterior.max())
    log_evidence = most + float(np.log(np.mean(np.exp(look.log_posterior - most))))
    chains = _Chains(Borders.joined([each.borders for each in kept]), np.concatenate([each.log_posterior for each in kept]))
    return chains, log_evidence


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
