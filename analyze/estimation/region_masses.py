"""Masses of the shell and the interior on either side of a plane (docs/explanation/method.md, 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.cells import Cells, ShellCells
from analyze.estimation.mass_properties import InertialParameters, MassDistribution, ShellThickness
from analyze.estimation.plane_chains import PlaneChains, oriented, plane_posterior
from analyze.estimation.region_limits import RegionBounds
from analyze.estimation.region_problem import RegionProblem
from analyze.estimation.truncated_normal import shortest_intervals
from analyze.least_squares.intervals import SIGMAS_95
from analyze.types import Array

REGION_NAMES = ("shell", "upper", "lower")
"""Names of the regions in results: shell, interior above and below the dividing plane."""
MIN_PROBABILITY = 0.02
"""Probability of the smallest chi^2 below which the body is not a shell with two uniform parts inside."""
MIN_THICKNESS_PROBABILITY = 0.005
"""Smallest probability of a shell thickness that is taken into account."""
THICKNESS_STRIDE, EXAMINED_LOG_EVIDENCE = 3, 5.0
"""Stride of the thicknesses that are examined first, and the log evidence below the largest one down to which
their neighbours are examined too."""
THICKNESS_DRAWS = 4000
"""Number of draws of the thickness."""


def mass_distribution(
    parameters: InertialParameters, cells: Cells, rng: np.random.Generator, walls: Sequence[ShellCells] = ()
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
        walls: Cells for the other thicknesses that the shell may have, over which the bounds for any filling
            extend; empty if the thickness is known.

    Returns:
        Masses (3,) of R1, R2, R3 [kg] with covariance and 95 % intervals, and the dividing plane in O.
    """
    posterior = _shell_posterior(parameters, cells, rng)
    bounds = RegionBounds.over_walls(parameters, [(0.0, posterior.problem)] if not walls else [], walls)
    return _distribution([posterior], np.ones(1), parameters, bounds, rng)


def mass_distribution_over(
    parameters: InertialParameters,
    shells: Sequence[ShellCells],
    rng: np.random.Generator,
    walls: Sequence[ShellCells] = (),
) -> MassDistribution:
    """Masses of three uniform regions, averaged over an unknown shell thickness.

    The regions are the shell (outer wall) and the interior on either side of a plane. The weight of a
    thickness is its evidence: the probability of the measured moments with this thickness.

    Args:
        parameters: Mass, centre of mass and moments with their joint covariance.
        shells: Cells (small pieces that fill the body, in shell or interior) for two or more shell
            thicknesses in a geometric series; each thickness stands for an equal range of the logarithm, over
            which the prior is uniform.
        rng: Random generator of the chains; the same seed gives the same result.
        walls: Cells for thicknesses beyond that series, to which the bounds for any filling extend.

    Returns:
        Masses (3,) [kg] of shell, interior above and below the plane (above is the side of its normal), with
        covariance and 95 % intervals; the plane in the object frame O; the estimated thickness [m].
    """
    by_shell = _likely_posteriors(parameters, shells, rng)
    posteriors = list(by_shell.values())
    evidence = np.full(len(shells), -np.inf)
    evidence[list(by_shell)] = [each.log_evidence for each in posteriors]
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    problems = [(shells[i].thickness, each.problem) for i, each in by_shell.items()]
    others = [shell for i, shell in enumerate(shells) if i not in by_shell]
    bounds = RegionBounds.over_walls(parameters, problems, [*others, *walls])
    found = _distribution(posteriors, weight[list(by_shell)], parameters, bounds, rng)
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
    chains: PlaneChains
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
    chains, log_evidence = plane_posterior(problem, rng)
    shares = chains.planes.shares.draw(rng)
    masses = shares * rng.normal(parameters.mass, parameters.mass_sd, len(shares))[:, None]
    return _ShellPosterior(problem, chains, log_evidence, masses, float(chains.planes.misfit(shares).min()))


def _likely_posteriors(
    parameters: InertialParameters, shells: Sequence[ShellCells], rng: np.random.Generator
) -> dict[int, _ShellPosterior]:
    """Posteriors of masses and dividing plane for the likely shell thicknesses, by index in `shells`.

    Every third thickness is examined, and each neighbour of one whose log evidence (log probability of the
    measured moments with this thickness) is within `EXAMINED_LOG_EVIDENCE` of the largest. Keys ascend; all
    thicknesses left out are improbable.
    """
    found: dict[int, _ShellPosterior] = {}
    wanted = set(range(0, len(shells), THICKNESS_STRIDE))
    while wanted:
        found |= {i: _shell_posterior(parameters, shells[i].cells, rng) for i in sorted(wanted)}
        best = max(each.log_evidence for each in found.values())
        likely = [i for i, each in found.items() if each.log_evidence > best - EXAMINED_LOG_EVIDENCE]
        wanted = {i + side for i in likely for side in (-1, 1)} & set(range(len(shells))) - set(found)
    return dict(sorted(found.items()))


def _distribution(
    posteriors: Sequence[_ShellPosterior],
    weight: Array,
    parameters: InertialParameters,
    bounds: RegionBounds,
    rng: np.random.Generator,
) -> MassDistribution:
    """Masses of shell, upper and lower interior averaged over shell thicknesses, and the dividing plane.

    The dividing plane splits the interior; the upper part is the one on the side of its normal.

    Args:
        posteriors: Posterior of masses and dividing plane for each of w thicknesses.
        weight: (w,) probabilities of the thicknesses; those below `MIN_THICKNESS_PROBABILITY` are left out.
        parameters: Mass of the object.
        bounds: Bounds of the masses for any filling.
        rng: Random generator that selects draws.

    Returns:
        Masses [kg] in the order shell, upper, lower, with the best plane (in the object frame O) of the
        likeliest thickness. If no plane explains the moments at this thickness: the middles of the bounds,
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
    if problem.probability(first.misfit, thickness_fitted=len(posteriors) > 1) < MIN_PROBABILITY:
        return _unexplained_distribution(problem, bounds, parameters, first.misfit)
    return MassDistribution(
        names=REGION_NAMES,
        masses=masses.mean(axis=0),
        covariance=np.cov(masses.T),
        intervals=_intervals(masses, parameters.mass * _share_sd(planes.precision[best], swapped=side < 0)),
        limits=bounds.at_plane(normal, middle + height),
        misfit=first.misfit,
        explained=True,
        dividing_plane_normal=normal,
        dividing_plane_offset=middle + height,
        dividing_plane_offset_interval=(middle + float(min(low, height)), middle + float(max(high, height))),
        baselines=problem.baselines(parameters.mass, normal, height),
    )


def _intervals(masses: Array, sd: Array) -> Array:
    """Shortest 95 % intervals (3, 2) [kg] of the regions' masses.

    Half of the prior expects an empty part, so that nearly all draws of a part can be zero. An interval that
    begins at zero therefore ends no lower than it would without this prior: at 1.96 sd.

    Args:
        masses: (n, 3) draws [kg].
        sd: (3,) standard deviations of the masses [kg] for the best plane, before truncation at zero.
    """
    low, high = shortest_intervals(masses, 0.0)
    return np.stack([low, np.where(low > 0, high, np.maximum(high, SIGMAS_95 * sd))], axis=1)


def _share_sd(precision: Array, *, swapped: bool) -> Array:
    """Standard deviations (3,) of the mass shares of shell, upper and lower part of the interior.

    `precision` (2, 2) is the inverse covariance of the shares of shell and upper part; all three add up to 1.
    The sd of upper and lower part change places if `swapped`.
    """
    covariance = np.linalg.inv(precision)
    sd = np.sqrt(np.append(np.diag(covariance), covariance.sum()))
    return sd[[0, 2, 1]] if swapped else sd


def _unexplained_distribution(
    problem: RegionProblem, bounds: RegionBounds, parameters: InertialParameters, misfit: float
) -> MassDistribution:
    """Region masses [kg] of a body whose moments no dividing plane explains; their `explained` is False.

    The regions are the shell and the interior on either side of a plane through the body's middle, normal to
    its longest direction. The masses are the middles of the bounds for any filling of a uniform shell, moved
    in proportion to the bounds' widths so that their sum is the object's mass.

    Args:
        problem: Model of the moments by mass shares of the regions, for the likeliest shell thickness.
        bounds: Bounds of the masses for any filling.
        parameters: Mass of the object and its sd.
        misfit: Smallest chi^2 of the moments at any plane, to be reported.
    """
    across = float(problem.longest @ problem.middle)
    limits = bounds.at_plane(problem.longest, across)
    width, middle = np.ptp(limits, axis=1), limits.mean(axis=1)
    masses = middle + (parameters.mass - middle.sum()) * width / max(float(width.sum()), 1e-12)
    # The sd of a uniform distribution between the bounds; the masses are anticorrelated by their fixed sum.
    sd = np.maximum(width, 1e-9 * parameters.mass) / np.sqrt(12)
    share = sd**2 / np.sum(sd**2)
    covariance = np.diag(sd**2) - np.sum(sd**2) * np.outer(share, share)
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
    normals, heights = oriented(planes.normals, planes.heights, normal)
    masses = np.where((planes.normals @ normal < 0)[:, None], posterior.draws[:, [0, 2, 1]], posterior.draws)
    places = heights / np.maximum(normals @ normal, 0.2)
    if weight == 1.0:
        return masses, places
    chosen = rng.choice(len(masses), size=max(1, round(weight * len(masses))), replace=False)
    return masses[chosen], places[chosen]
