"""Masses of the shell and the interior on either side of a plane (docs/explanation/method.md, 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.cells import Cells, ShellCells
from analyze.estimation.dividing_surfaces import Kind, are_balls, oriented, planes
from analyze.estimation.mass_properties import InertialParameters, MassDistribution, ShellThickness
from analyze.estimation.plane_chains import SurfaceChains, surface_posterior
from analyze.estimation.region_limits import RegionBounds
from analyze.estimation.region_problem import RegionProblem
from analyze.estimation.truncated_normal import shortest_intervals
from analyze.least_squares.intervals import SIGMAS_95
from analyze.types import Array

REGION_NAMES = ("shell", "upper", "lower")
"""Names of the regions in results: shell, interior above and below the dividing plane."""
MIN_PROBABILITY = 0.02
"""Probability of the smallest chi^2 below which the body is not a shell with two uniform parts inside, on
either side of a plane, or inside and outside of a ball."""
MIN_THICKNESS_PROBABILITY = 0.005
"""Smallest probability of a shell thickness that is taken into account."""
THICKNESS_STRIDE, EXAMINED_LOG_EVIDENCE = 3, 5.0
"""Stride of the thicknesses that are examined first, and the log evidence below the largest one down to which
their neighbours are examined too."""
LUMP_SHAPE_ERROR = 0.01
"""Error of a region's mass over the object's mass, since a lump is no ball of one density."""
MIN_FILLED_DRAWS = 50
"""Fewest draws without an empty part that count in the intervals beside the others."""
THICKNESS_DRAWS = 4000
"""Number of draws of the thickness."""


def mass_distribution(
    parameters: InertialParameters, cells: Cells, rng: np.random.Generator, walls: Sequence[ShellCells] = ()
) -> MassDistribution:
    """Masses of shell (R1), interior where n.x > offset (R2) and elsewhere (R3), for uniform parts.

    The shell is the body's outer wall. The interior has two uniform parts, one of which may be empty: on
    either side of a plane, or inside and outside of a ball (a lump, a void). Metropolis chains draw this
    plane or ball from its posterior, with the mass shares integrated out. For each the shares are then drawn
    from their normal distribution, truncated at zero.

    n is the unit normal of the plane n.x = offset, in the object frame O, at an angle of at most 90 deg to
    the body's longest direction. It is the best plane that divides the interior in two uniform parts. If none
    has the measured moments, it passes through the body's middle, normal to its longest direction. The masses
    of a body with a ball are those on either side of it.

    The ball is also tried with nothing outside: few draws come near this corner of all possibilities. The
    intervals hold for bodies of these kinds. If even the best of them leaves a misfit beyond measurement
    error, the body is of another kind: then the intervals are the bounds for any filling of a uniform shell.

    Args:
        parameters: Mass, centre of mass and moments with their joint covariance.
        cells: Cells (small pieces) of the body, in shell and interior.
        rng: Random generator of the chains; the same seed gives the same result.
        walls: Cells for the other thicknesses that the shell may have, over which the bounds for any filling
            extend; empty if the thickness is known.

    Returns:
        Masses (3,) of R1, R2, R3 [kg] with covariance and 95 % intervals, and the dividing plane in O.
    """
    kinds = [_KindPosterior((_shell_posterior(parameters, cells, rng, kind),), np.ones(1)) for kind in Kind]
    bounds = RegionBounds.over_walls(parameters, [(0.0, kinds[0].first.problem)] if not walls else [], walls)
    return _distribution(kinds, parameters, bounds, rng)


def mass_distribution_over(
    parameters: InertialParameters,
    shells: Sequence[ShellCells],
    rng: np.random.Generator,
    walls: Sequence[ShellCells] = (),
) -> MassDistribution:
    """Masses of shell and interior on either side of a plane, averaged over an unknown shell thickness.

    The shell is the outer wall. The interior has two uniform parts, on either side of the plane or inside and
    outside of a ball (a lump, a void). The weight of a thickness is its evidence: the probability of the
    measured moments with this thickness.

    Args:
        parameters: Mass, centre of mass and moments with their joint covariance.
        shells: Cells (small pieces that fill the body, in shell or interior) for two or more shell
            thicknesses in a geometric series; each thickness stands for an equal range of the logarithm, over
            which the prior is uniform.
        rng: Random generator of the chains; the same seed gives the same result.
        walls: Cells for thicknesses beyond that series, to which the bounds for any filling extend.

    Returns:
        Masses (3,) [kg] of shell, interior above and below the plane (above is the side of its normal), with
        covariance and 95 % intervals; the plane in the object frame O; the thickness [m], open if no parts on
        either side of a plane have the measured moments.
    """
    kinds: list[_KindPosterior] = []
    weights: list[Array] = []
    problems: dict[int, RegionProblem] = {}
    for kind in Kind:
        by_shell = _likely_posteriors(parameters, shells, rng, kind)
        evidence = np.full(len(shells), -np.inf)
        evidence[list(by_shell)] = [each.log_evidence for each in by_shell.values()]
        weight = np.exp(evidence - evidence.max())
        weight /= weight.sum()
        kinds.append(_KindPosterior(tuple(by_shell.values()), weight[list(by_shell)]))
        weights.append(weight)
        problems |= {i: each.problem for i, each in by_shell.items()}
    others = [shell for i, shell in enumerate(shells) if i not in problems]
    solved = [(shells[i].thickness, problem) for i, problem in problems.items()]
    bounds = RegionBounds.over_walls(parameters, solved, [*others, *walls])
    found = _distribution(kinds, parameters, bounds, rng)
    by_planes = kinds[0].explains
    weight = np.mean(
        [w for kind, w in zip(kinds, weights, strict=True) if kind.explains or not by_planes], axis=0
    )
    return replace(found, shell=_shell_thickness(shells, weight if by_planes else None, rng))


def _shell_thickness(
    shells: Sequence[ShellCells], weight: Array | None, rng: np.random.Generator
) -> ShellThickness:
    """Thickness [m] of the shell with 95 % interval, from probabilities `weight` (n,) of n thicknesses.

    Without `weight` it is open: the interval is the range of all thicknesses. `shells` are in a geometric
    series; each stands for an equal range of the logarithm.
    """
    logs = np.log([shell.thickness for shell in shells])
    step = float(logs[1] - logs[0])
    drawn = np.exp(
        rng.choice(logs, size=THICKNESS_DRAWS, p=weight) + rng.uniform(-0.5, 0.5, THICKNESS_DRAWS) * step
    )
    swept = (float(np.exp(logs[0] - step / 2)), float(np.exp(logs[-1] + step / 2)))
    low, high = (
        swept if weight is None else (float(end[0]) for end in shortest_intervals(drawn[:, None], 0.0))
    )
    return ShellThickness(float(drawn.mean()), float(drawn.std()), (low, high), swept)


@dataclass(frozen=True)
class _ShellPosterior:
    """Posterior of dividing surface and region masses for one shell thickness, as draws.

    The surface, a plane or a ball, divides the interior into an upper and a lower part; the third region is
    the shell.
    """

    problem: RegionProblem
    """Moments of the regions as functions of the dividing surface, and the measured ones."""
    chains: SurfaceChains
    """Dividing planes and balls drawn from their posterior."""
    log_evidence: float
    """Log evidence of the thickness, up to a constant that all thicknesses share."""
    shares: Array
    """(n, 3) mass shares of shell, upper and lower part, one draw per dividing surface."""
    mass: Array
    """(n,) draws of the object's mass [kg]."""
    misfit: float
    """Smallest chi^2 of the draws."""

    @property
    def balls(self) -> bool:
        """True if the dividing surfaces are balls, False if they are planes."""
        return bool(are_balls(self.chains.solved.surfaces).any())


@dataclass(frozen=True)
class _KindPosterior:
    """Posteriors of bodies of one kind, for each of w shell thicknesses.

    A kind is how the interior is divided: by a plane, by a ball, or by a ball with nothing outside (`Kind`).
    """

    posteriors: tuple[_ShellPosterior, ...]
    """(w,) posteriors of dividing surface and masses."""
    weight: Array
    """(w,) probabilities of the thicknesses, given the kind."""

    @property
    def first(self) -> _ShellPosterior:
        """Posterior of dividing surface and region masses for the likeliest shell thickness."""
        return self.posteriors[int(np.argmax(self.weight))]

    @property
    def explains(self) -> bool:
        """True if a body divided by planes, or balls, has the measured moments within their errors."""
        fitted = len(self.posteriors) > 1
        return self.first.problem.probability(self.first.misfit, thickness_fitted=fitted) >= MIN_PROBABILITY


def _shell_posterior(
    parameters: InertialParameters, cells: Cells, rng: np.random.Generator, kind: Kind
) -> _ShellPosterior:
    """Posterior of dividing surface and region masses for one shell thickness: draws, and evidence.

    The regions are the shell (outer wall), and the interior above and below the surface: a plane or, by
    `kind` of body, a ball. The draws of their mass shares are (n, 3), one per drawn surface. The evidence is
    the log probability of the measured moments with this thickness, up to a constant. `cells` are the small
    pieces of the body, divided for this thickness.
    """
    problem = RegionProblem(parameters, cells)
    chains, log_evidence = surface_posterior(problem, rng, kind)
    shares = chains.solved.shares.draw(rng)
    mass = rng.normal(parameters.mass, parameters.mass_sd, len(shares))
    return _ShellPosterior(
        problem, chains, log_evidence, shares, mass, float(chains.solved.misfit(shares).min())
    )


def _likely_posteriors(
    parameters: InertialParameters, shells: Sequence[ShellCells], rng: np.random.Generator, kind: Kind
) -> dict[int, _ShellPosterior]:
    """Posteriors of masses and dividing surface for the likely shell thicknesses, by index in `shells`.

    Every third thickness is examined, and each neighbour of one whose log evidence (log probability of the
    measured moments with this thickness) is within `EXAMINED_LOG_EVIDENCE` of the largest. Keys ascend; all
    thicknesses left out are improbable.
    """
    found: dict[int, _ShellPosterior] = {}
    wanted = set(range(0, len(shells), THICKNESS_STRIDE))
    while wanted:
        found |= {i: _shell_posterior(parameters, shells[i].cells, rng, kind) for i in sorted(wanted)}
        best = max(each.log_evidence for each in found.values())
        likely = [i for i, each in found.items() if each.log_evidence > best - EXAMINED_LOG_EVIDENCE]
        wanted = {i + side for i in likely for side in (-1, 1)} & set(range(len(shells))) - set(found)
    return dict(sorted(found.items()))


def _distribution(
    kinds: Sequence[_KindPosterior],
    parameters: InertialParameters,
    bounds: RegionBounds,
    rng: np.random.Generator,
) -> MassDistribution:
    """Masses of shell, upper and lower interior over bodies of all kinds, and the dividing plane.

    The dividing plane splits the interior; the upper part is the one on the side of its normal. A kind is how
    a body's interior is divided: by a plane, by a ball, or by a ball with nothing outside. Kinds that have
    the measured moments count alike in the intervals: a body is only like one of them, so that a somewhat
    better fit of one does not rule out the other. The masses themselves are those of parts beside a plane, if
    these have the moments.

    Args:
        kinds: Posteriors of the kinds of body, of which the first is divided by planes.
        parameters: Mass of the object.
        bounds: Bounds of the masses for any filling.
        rng: Random generator that selects draws.

    Returns:
        Masses [kg] in the order shell, upper, lower, with the best plane (in the object frame O) of the
        likeliest thickness, or the plane through the body's middle if no plane has the moments. If no ball
        has them either: the middles of the bounds, moved so that their sum is the object's mass; `explained`
        is then False.
    """
    flat, first = kinds[0].explains, kinds[0].first
    problem, misfit = first.problem, min(kind.first.misfit for kind in kinds)
    explaining = [kind for kind in kinds if kind.explains]
    if not explaining:
        return _unexplained_distribution(problem, bounds, parameters, misfit)
    plane = planes(problem.longest[None], np.zeros(1))
    if flat:
        plane = first.chains.solved.surfaces[[np.argmax(first.chains.log_posterior)]]
    plane = oriented(plane, problem.longest)[0]
    normal, height = plane[:3], float(plane[3])
    middle = float(normal @ problem.middle)
    drawn = [
        _weighted_draws(each, float(w), plane, rng)
        for kind in explaining
        for each, w in zip(kind.posteriors, kind.weight, strict=True)
        if w >= MIN_THICKNESS_PROBABILITY
    ]
    masses = np.concatenate([each for each, _ in drawn])
    # Two uniform parts beside a plane are the usual body; the other kinds only widen what is stated.
    parts = int(np.sum(kinds[0].weight >= MIN_THICKNESS_PROBABILITY)) if flat else len(drawn)
    estimate = np.concatenate([each for each, _ in drawn[:parts]]).mean(axis=0)
    apart = masses - estimate
    places = np.concatenate([each for _, each in drawn]) if flat else np.array([height])
    low, high = np.quantile(places, [0.025, 0.975])
    sd = np.max([_share_sd(kind.first, normal) for kind in explaining], axis=0)
    intervals, lump = _intervals(masses, parameters.mass * sd), any(kind.explains for kind in kinds[1:])
    if lump:
        shape = LUMP_SHAPE_ERROR * parameters.mass * np.array([-1.0, 1.0])
        intervals = np.clip(intervals + shape, 0.0, max(parameters.mass, float(intervals.max())))
    return MassDistribution(
        names=REGION_NAMES,
        masses=estimate,
        covariance=apart.T @ apart / (len(masses) - 1),
        intervals=np.column_stack(
            [np.minimum(intervals[:, 0], estimate), np.maximum(intervals[:, 1], estimate)]
        ),
        limits=bounds.at_plane(normal, middle + height),
        misfit=misfit,
        explained=True,
        dividing_plane_normal=normal,
        dividing_plane_offset=middle + height,
        dividing_plane_offset_interval=(middle + float(min(low, height)), middle + float(max(high, height))),
        baselines=problem.baselines(parameters.mass, normal, height),
        two_parts_explain=flat,
        lump_explains=lump,
    )


def _intervals(masses: Array, sd: Array) -> Array:
    """Shortest 95 % intervals (3, 2) [kg] of the regions' masses.

    Half of the prior expects an empty part, so that nearly all draws of a part can be zero, and what remains
    of the other half vanish from the intervals. They therefore also hold for the draws without an empty part,
    and one that begins at zero ends no lower than at 1.96 sd.

    Args:
        masses: (n, 3) draws [kg].
        sd: (3,) standard deviations of the masses [kg] for the best plane, before truncation at zero.
    """
    low, high = shortest_intervals(masses, 0.0)
    filled = masses[(masses > 0).all(axis=1)]
    if len(filled) >= MIN_FILLED_DRAWS:
        other_low, other_high = shortest_intervals(filled, 0.0)
        low, high = np.minimum(low, other_low), np.maximum(high, other_high)
    return np.stack([low, np.where(low > 0, high, np.maximum(high, SIGMAS_95 * sd))], axis=1)


def _share_sd(posterior: _ShellPosterior, normal: Array) -> Array:
    """Standard deviations (3,) of the mass shares of shell, upper and lower part, for the best surface.

    The surface is a plane or a ball. The upper part is the one on the side of `normal` (3,); for a ball, what
    is outside it lies on both sides, and its sd is that of both parts.
    """
    best, solved = int(np.argmax(posterior.chains.log_posterior)), posterior.chains.solved
    covariance: Array = np.asarray(np.linalg.inv(solved.precision[best]), dtype=np.float64)
    sd = np.sqrt(np.append(np.diag(covariance), covariance.sum()))
    if posterior.balls:
        return sd[[0, 2, 2]]
    return sd[[0, 2, 1]] if solved.surfaces[best, :3] @ normal < 0 else sd


def _unexplained_distribution(
    problem: RegionProblem, bounds: RegionBounds, parameters: InertialParameters, misfit: float
) -> MassDistribution:
    """Region masses [kg] of a body whose moments no plane or ball explains; their `explained` is False.

    The regions are the shell and the interior on either side of a plane through the body's middle, normal to
    its longest direction. The masses are the middles of the bounds for any filling of a uniform shell, moved
    in proportion to the bounds' widths so that their sum is the object's mass.

    Args:
        problem: Model of the moments by mass shares of the regions, for the likeliest shell thickness.
        bounds: Bounds of the masses for any filling.
        parameters: Mass of the object and its sd.
        misfit: Smallest chi^2 of the moments for any plane or ball, to be reported.
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
    posterior: _ShellPosterior, weight: float, plane: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Draws (n, 3) of the region masses [kg], and places (m,) [m] where their dividing planes cut a line.

    Masses are those of shell, upper and lower part; the upper part is the one towards the reported plane's
    normal for every draw. The parts inside and outside of a ball are divided by the reported plane. The line
    runs through the body's middle along its normal; a place is measured along it from the middle. For a plane
    nearly parallel to the line, the place is limited to five times the plane's distance from the middle.
    Balls have none (m is 0).

    Args:
        posterior: Posterior for one shell thickness.
        weight: Probability of that thickness, to which the number n of draws is proportional.
        plane: (5,) reported plane: unit normal (3), height over the body's middle [m], 0.
        rng: Random generator that selects draws.
    """
    drawn, shares, mass = posterior.chains.solved.surfaces, posterior.shares, posterior.mass
    if weight < 1.0:
        chosen = rng.choice(len(drawn), size=max(1, round(weight * len(drawn))), replace=False)
        drawn, shares, mass = drawn[chosen], shares[chosen], mass[chosen]
    if posterior.balls:
        return posterior.problem.divided(drawn, shares, plane) * mass[:, None], np.zeros(0)
    along, normal = oriented(drawn, plane[:3]), plane[:3]
    shares = np.where((drawn[:, :3] @ normal < 0)[:, None], shares[:, [0, 2, 1]], shares)
    return shares * mass[:, None], along[:, 3] / np.maximum(along[:, :3] @ normal, 0.2)
