"""Masses of the shell and the interior on either side of a plane (docs/explanation/method.md, 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.cells import Cells, ShellCells
from analyze.estimation.region_limits import region_limits
from analyze.estimation.region_problem import DividingPlanes, RegionProblem
from analyze.estimation.truncated_normal import shortest_intervals
from analyze.types import Array, InertialParameters, IntArray, MassDistribution, ShellThickness

REGION_NAMES = ("shell", "upper", "lower")
"""Names of the regions in results: shell, interior above and below the dividing plane."""
RANDOM_PLANES = 3000
"""Number of random positions of the dividing plane from which the chains start."""
CHAINS = 200
"""Number of Metropolis chains."""
COOLING_STEPS, KEPT_STEPS = 12, 10
"""Steps of each chain while it cools, and afterwards, when every position is kept."""
MAX_TEMPERATURE = 10.0
"""Initial temperature of the posterior, so that the chains find all its modes."""
DIFFERENCE_MOVES = 0.5
"""Share of the moves along the difference of two other chains, which scales with the mode's width (ter Braak
2006)."""
MOVE_SIZES = (0.02, 0.1, 0.3)
"""Sizes [rad] of the other moves."""
MIN_PROBABILITY = 0.02
"""Probability of the smallest chi^2 below which the body is not a shell with two uniform parts inside."""
MIN_THICKNESS_PROBABILITY = 0.005
"""Smallest probability of a shell thickness that is taken into account."""
THICKNESS_DRAWS = 4000
"""Number of draws of the thickness."""


def mass_distribution(
    parameters: InertialParameters, cells: Cells, rng: np.random.Generator
) -> MassDistribution:
    """Masses of three uniform regions: shell (R1), interior where n.x > offset (R2) and elsewhere (R3).

    The shell is the body's outer wall. n is the unit normal of the plane n.x = offset that divides the
    interior, in the object frame O, at an angle of at most 90 deg to the body's longest direction. Metropolis
    chains draw direction and offset of this plane from its posterior, with the mass shares integrated out.
    For each plane the shares are then drawn from their normal distribution, truncated at zero.

    The intervals hold for a body of three such regions. If even the best plane leaves a misfit beyond
    measurement error, the body is of another kind: then the dividing plane passes through its middle, normal
    to its longest direction, and the intervals are the bounds for any filling of a uniform shell.

    Args:
        parameters: Mass, centre of mass and moments with their joint covariance.
        cells: Cells (small pieces) of the body, in shell and interior.
        rng: Random generator of the chains; the same seed gives the same result.

    Returns:
        Masses (3,) of R1, R2, R3 [kg] with covariance and 95 % intervals, and the dividing plane in O.
    """
    return _distribution([_shell_posterior(parameters, cells, rng)], np.ones(1), parameters, rng)


def mass_distribution_over(
    parameters: InertialParameters, shells: Sequence[ShellCells], rng: np.random.Generator
) -> MassDistribution:
    """Masses of three uniform regions, averaged over an unknown shell thickness.

    The regions are the shell and the interior on either side of a plane. The weight of a thickness is its
    evidence: the probability of the measured moments with this thickness.

    Args:
        parameters: Mass, centre of mass and moments with their joint covariance.
        shells: Cells (small pieces that fill the body, in shell or interior) for two or more shell
            thicknesses in a geometric series; each thickness stands for an equal range of the logarithm, over
            which the prior is uniform.
        rng: Random generator of the chains; the same seed gives the same result.

    Returns:
        Masses [kg] with covariance and intervals, the dividing plane, and the estimated thickness.
    """
    posteriors = [_shell_posterior(parameters, shell.cells, rng) for shell in shells]
    evidence = np.array([each.log_evidence for each in posteriors])
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    found = _distribution(posteriors, weight, parameters, rng)
    logs = np.log([shell.thickness for shell in shells])
    step = float(logs[1] - logs[0])
    drawn = np.exp(
        rng.choice(logs, size=THICKNESS_DRAWS, p=weight) + rng.uniform(-0.5, 0.5, THICKNESS_DRAWS) * step
    )
    low, high = (float(end[0]) for end in shortest_intervals(drawn[:, None], 0.0))
    swept = (float(np.exp(logs[0] - step / 2)), float(np.exp(logs[-1] + step / 2)))
    return replace(found, shell=ShellThickness(float(drawn.mean()), float(drawn.std()), (low, high), swept))


@dataclass(frozen=True)
class _ShellPosterior:
    """Posterior of dividing plane and region masses for one shell thickness, as draws.

    The plane divides the interior into an upper and a lower part; the third region is the shell.
    """

    problem: RegionProblem
    """Moments of the regions as functions of the dividing plane, and the measured ones."""
    chains: _Chains
    """Dividing planes drawn from their posterior."""
    log_evidence: float
    """Log evidence of the thickness, up to a constant that all thicknesses share."""
    draws: Array
    """(n, 3) masses of shell, upper and lower part [kg], one draw per dividing plane."""
    misfit: float
    """Smallest chi^2 of the draws."""


def _shell_posterior(
    parameters: InertialParameters, cells: Cells, rng: np.random.Generator
) -> _ShellPosterior:
    """Posterior of dividing plane and region masses for one shell thickness, as draws, with its evidence.

    The regions are the shell (outer wall), and the interior above and below the plane. The draws of their
    masses are (n, 3) [kg], one per drawn plane. The evidence is the log probability of the measured moments
    with this thickness, up to a constant. `cells` are the small pieces of the body divided for it.
    """
    problem = RegionProblem(parameters, cells)
    chains, log_evidence = _posterior(problem, rng)
    shares = chains.planes.shares.draw(rng)
    masses = shares * rng.normal(parameters.mass, parameters.mass_sd, len(shares))[:, None]
    return _ShellPosterior(problem, chains, log_evidence, masses, float(chains.planes.misfit(shares).min()))


def _distribution(
    posteriors: Sequence[_ShellPosterior],
    weight: Array,
    parameters: InertialParameters,
    rng: np.random.Generator,
) -> MassDistribution:
    """Masses of shell, upper and lower interior averaged over shell thicknesses, and the dividing plane.

    The dividing plane splits the interior; the upper part is the one on the side of its normal.

    Args:
        posteriors: Posterior of masses and dividing plane for each of w thicknesses.
        weight: (w,) probabilities of the thicknesses; those below `MIN_THICKNESS_PROBABILITY` are left out.
        parameters: Mass of the object.
        rng: Random generator that selects draws.

    Returns:
        Masses [kg] in the order shell, upper, lower, with the best plane (in the object frame O) of the
        likeliest thickness. If no plane explains the moments: the middles of the bounds for any filling,
        moved so that their sum is the object's mass, with the plane through the body's middle; `explained` is
        then False.
    """
    first = posteriors[int(np.argmax(weight))]
    problem, planes = first.problem, first.chains.planes
    best = int(np.argmax(first.chains.log_posterior))
    side = -1.0 if planes.normals[best] @ problem.longest < 0 else 1.0
    normal, height = side * planes.normals[best], side * float(planes.heights[best])
    middle = float(normal @ problem.middle)
    counted = [
        (each, float(w)) for each, w in zip(posteriors, weight, strict=True) if w >= MIN_THICKNESS_PROBABILITY
    ]
    masses, places = [
        np.concatenate(parts)
        for parts in zip(*(_weighted_draws(each, w, normal, rng) for each, w in counted), strict=True)
    ]
    low, high = np.quantile(places, [0.025, 0.975])
    ends = np.array(
        [
            region_limits(each.problem, normal, middle + height - float(normal @ each.problem.middle))
            for each, _ in counted
        ]
    )
    limits = parameters.mass * np.stack([ends[..., 0].min(axis=0), ends[..., 1].max(axis=0)], axis=1)
    misfit = min(each.misfit for each, _ in counted)
    if problem.probability(misfit) < MIN_PROBABILITY:
        return _unexplained_distribution(problem, [each.problem for each, _ in counted], parameters, misfit)
    return MassDistribution(
        names=REGION_NAMES,
        masses=masses.mean(axis=0),
        covariance=np.cov(masses.T),
        intervals=np.stack(shortest_intervals(masses, 0.0), axis=1),
        limits=limits,
        misfit=misfit,
        explained=True,
        dividing_plane_normal=normal,
        dividing_plane_offset=middle + height,
        dividing_plane_offset_interval=(middle + float(min(low, height)), middle + float(max(high, height))),
        baselines=problem.baselines(parameters.mass, normal, height),
    )


def _unexplained_distribution(
    problem: RegionProblem, counted: Sequence[RegionProblem], parameters: InertialParameters, misfit: float
) -> MassDistribution:
    """Region masses of a body whose moments no dividing plane explains; their `explained` is False.

    The regions are the shell and the interior on either side of a plane through the body's middle, normal to
    its longest direction. The masses are the middles of the bounds for any filling of a uniform shell, moved
    in proportion to the bounds' widths so that their sum is the object's mass.

    Args:
        problem: Problem of the mass shares for the likeliest shell thickness.
        counted: Problems of all thicknesses that are not too improbable.
        parameters: Mass of the object and its sd.
        misfit: Smallest chi^2 of the moments at any plane, to be reported.
    """
    ends = np.array([region_limits(each, problem.longest, 0.0) for each in counted])
    limits = parameters.mass * np.stack([ends[..., 0].min(axis=0), ends[..., 1].max(axis=0)], axis=1)
    width, middle = np.ptp(limits, axis=1), limits.mean(axis=1)
    masses = middle + (parameters.mass - middle.sum()) * width / max(float(width.sum()), 1e-12)
    # The sd of a uniform distribution between the bounds; the masses are anticorrelated by their fixed sum.
    sd = np.maximum(width, 1e-9 * parameters.mass) / np.sqrt(12)
    share = sd**2 / np.sum(sd**2)
    covariance = np.diag(sd**2) - np.sum(sd**2) * np.outer(share, share)
    across = float(problem.longest @ problem.middle)
    return MassDistribution(
        names=REGION_NAMES,
        masses=masses,
        covariance=covariance + np.outer(masses, masses) * (parameters.mass_sd / parameters.mass) ** 2,
        intervals=np.stack([np.minimum(limits[:, 0], masses), np.maximum(limits[:, 1], masses)], axis=1),
        limits=limits,
        misfit=misfit,
        explained=False,
        dividing_plane_normal=problem.longest,
        dividing_plane_offset=across,
        dividing_plane_offset_interval=(across, across),
        baselines=problem.baselines(parameters.mass, problem.longest, 0.0),
    )


def _weighted_draws(
    posterior: _ShellPosterior, weight: float, normal: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Draws (n, 3) of the region masses [kg], and places (n,) [m] where their dividing planes cut a line.

    Masses are those of shell, upper and lower part; the upper part is the one towards `normal` for every
    draw. The line runs through the body's middle along `normal`; a place is measured along it from the
    middle. For a plane nearly parallel to the line, the place is limited to five times the plane's distance
    from the middle.

    Args:
        posterior: Posterior for one shell thickness.
        weight: Probability of that thickness, to which the number n of draws is proportional.
        normal: (3,) unit normal of the best plane, in the object frame O.
        rng: Random generator that selects draws.
    """
    planes = posterior.chains.planes
    # The upper part is the one on the side of the best plane's normal, for every plane.
    normals, heights = _oriented(planes.normals, planes.heights, normal)
    masses = np.where((planes.normals @ normal < 0)[:, None], posterior.draws[:, [0, 2, 1]], posterior.draws)
    places = heights / np.maximum(normals @ normal, 0.2)
    if weight == 1.0:
        return masses, places
    chosen = rng.choice(len(masses), size=max(1, round(weight * len(masses))), replace=False)
    return masses[chosen], places[chosen]


@dataclass(frozen=True)
class _Chains:
    """Present states of b Metropolis chains (random walks), with the log posterior of each.

    The state of a chain is a plane that divides the body's interior in two.
    """

    planes: DividingPlanes
    """Position of each chain, with the mass shares that fit it."""
    log_posterior: Array
    """(b,) log posterior, the mass shares integrated out."""

    @classmethod
    def of_planes(cls, planes: DividingPlanes) -> _Chains:
        """Chains (random walks over dividing planes) at b start planes, with the planes' log posteriors (b,).

        Each plane divides the body's interior in two. A log posterior is the logarithm, up to a constant, of
        the plane's probability given the measurements; -1e300 for a plane with next to nothing of the
        interior on one side.
        """
        possible = np.where(planes.both_sides_filled, planes.shares.log_mass - planes.chi_square / 2, -1e300)
        return cls(planes, possible)


def _posterior(problem: RegionProblem, rng: np.random.Generator) -> tuple[_Chains, float]:
    """Draws of the plane that divides the interior in two, and the log evidence of the shell's thickness.

    The evidence, a likelihood of the thickness, is the mean of prior times likelihood over random planes
    everywhere. Metropolis chains start at some of these planes; their temperature falls from
    `MAX_TEMPERATURE` to 1, so that they find all modes of the plane's posterior.

    Args:
        problem: Measured moments and the body, from which the masses follow, for one shell thickness.
        rng: Random generator.

    Returns:
        Dividing planes with their log posterior: one per chain (`CHAINS`) and step (`KEPT_STEPS`), 2000 in
        all; and the log evidence, up to a constant that all thicknesses share.
    """
    normals = _unit(rng.standard_normal((RANDOM_PLANES, 3)))
    heights = rng.uniform(-0.5, 0.5, RANDOM_PLANES) * problem.reach
    look = _Chains.of_planes(problem.solve(normals, heights, coarsely=True))
    # n and -n are one plane: all normals on one side, so that differences of two chains are meaningful.
    near = normals[int(np.argmax(look.log_posterior))]

    def solved(normals: Array, heights: Array, *, coarsely: bool = False) -> _Chains:
        return _Chains.of_planes(problem.solve(*_oriented(normals, heights, near), coarsely=coarsely))

    chosen = _resampled(look.log_posterior / MAX_TEMPERATURE, CHAINS, rng)
    chains = solved(normals[chosen], heights[chosen], coarsely=True)
    for step in range(COOLING_STEPS):
        there = solved(*_proposals(chains.planes, problem.reach, rng), coarsely=True)
        chains = _metropolis_step(chains, there, MAX_TEMPERATURE ** (1 - step / COOLING_STEPS), rng)
    chains = solved(chains.planes.normals, chains.planes.heights)
    kept: list[_Chains] = []
    for _ in range(KEPT_STEPS):
        chains = _metropolis_step(chains, solved(*_proposals(chains.planes, problem.reach, rng)), 1.0, rng)
        kept.append(chains)
    most = float(look.log_posterior.max())
    log_evidence = most + float(np.log(np.mean(np.exp(look.log_posterior - most))))
    chains = _Chains(
        DividingPlanes.concatenate([each.planes for each in kept]),
        np.concatenate([each.log_posterior for each in kept]),
    )
    return chains, log_evidence


def _metropolis_step(
    chains: _Chains, there: _Chains, temperature: float, rng: np.random.Generator
) -> _Chains:
    """Metropolis chains after one step: each keeps its dividing plane, or takes the one proposed to it.

    Args:
        chains: planes of the b chains, with their log posterior.
        there: the b proposed planes, with their log posterior.
        temperature: 1 samples the posterior; above 1 moves to a lower posterior are accepted more often.
        rng: random generator.
    """
    raised = there.log_posterior + temperature * rng.exponential(size=len(there.log_posterior))
    accept = raised > chains.log_posterior
    return _Chains(
        chains.planes.replaced_where(accept, there.planes),
        np.where(accept, there.log_posterior, chains.log_posterior),
    )


def _proposals(planes: DividingPlanes, reach: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Proposed planes for b Metropolis chains: normals (b, 3) and heights (b,) [m] over the body's middle.

    Each plane is turned and shifted at random; a proposal and its reverse are equally likely. A share
    `DIFFERENCE_MOVES` of them moves by the difference of two other chains' planes.

    Args:
        planes: Present positions of the chains.
        reach: Extent of the body along its longest direction [m], which scales the shifts.
        rng: Random generator.
    """
    many = len(planes.heights)
    size = rng.choice(MOVE_SIZES, size=many)
    turn = size[:, None] * rng.standard_normal((many, 3))
    shift = 0.3 * size * reach * rng.standard_normal(many)
    first, second = rng.integers(many, size=(2, many))
    along = rng.uniform(size=many) < DIFFERENCE_MOVES
    turn = np.where(along[:, None], planes.normals[first] - planes.normals[second] + 0.05 * turn, turn)
    shift = np.where(along, planes.heights[first] - planes.heights[second] + 0.05 * shift, shift)
    return _unit(planes.normals + turn), planes.heights + shift


def _resampled(log_weight: Array, count: int, rng: np.random.Generator) -> IntArray:
    """Indices (count,) of `log_weight`, drawn in proportion to exp(`log_weight`) by systematic resampling."""
    weight = np.exp(log_weight - log_weight.max())
    edges = np.cumsum(weight) / weight.sum()
    return np.minimum(np.searchsorted(edges, (np.arange(count) + rng.uniform()) / count), len(weight) - 1)


def _oriented(normals: Array, heights: Array, towards: Array) -> tuple[Array, Array]:
    """Normals (b, 3) and heights (b,) [m] of b planes, with all normals on the side of `towards` (3,).

    A plane whose normal points to the other side has the signs of normal and height reversed, and so stays in
    place.
    """
    side = np.where(normals @ towards < 0, -1.0, 1.0)
    return normals * side[:, None], heights * side


def _unit(vectors: Array) -> Array:
    """Unit vectors (b, 3) along `vectors` (b, 3)."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
