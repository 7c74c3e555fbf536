"""Posterior of the plane that divides a body's interior in two, by Metropolis chains that cool down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.estimation.region_problem import DividingPlanes, RegionProblem
from analyze.types import Array, IntArray

RANDOM_PLANES = 3000
"""Number of random positions of the dividing plane from which the chains start."""
CHAINS = 200
"""Number of Metropolis chains."""
COOLING_MOVES, KEPT_STEPS = 2, 10
"""Steps of each chain at every temperature while it cools, and at the end, when every position is kept."""
EFFECTIVE_CHAINS = 0.5 * CHAINS
"""Effective number of chains (sum of weights squared over sum of squares) that a lower temperature leaves."""
DIFFERENCE_MOVES = 0.5
"""Share of the moves along the difference of two other chains, which scales with the mode's width (ter Braak
2006)."""
MOVE_SIZES = (0.02, 0.1, 0.3)
"""Sizes [rad] of the moves that do not follow the difference of two chains."""


@dataclass(frozen=True)
class PlaneChains:
    """Present states of b Metropolis chains (random walks), with the log posterior of each.

    The state of a chain is a plane that divides the body's interior in two.
    """

    planes: DividingPlanes
    """Position of each chain, with the mass shares that fit it."""
    log_posterior: Array
    """(b,) log posterior, the mass shares integrated out."""

    @classmethod
    def of_planes(cls, planes: DividingPlanes) -> PlaneChains:
        """Chains (random walks over dividing planes) at b start planes, with the planes' log posteriors (b,).

        Each plane divides the body's interior in two. A log posterior is the logarithm, up to a constant, of
        the plane's probability given the measurements; -1e300 for a plane with next to nothing of the
        interior on one side.
        """
        possible = np.where(planes.both_sides_filled, planes.shares.log_mass - planes.chi_square / 2, -1e300)
        return cls(planes, possible)

    def selected(self, chosen: IntArray) -> PlaneChains:
        """Chains (random walks over dividing planes) with the indices `chosen` (n,), in this order."""
        fields = (getattr(self.planes, name)[chosen] for name in self.planes.__dataclass_fields__)
        return PlaneChains(DividingPlanes(*fields), self.log_posterior[chosen])


def plane_posterior(problem: RegionProblem, rng: np.random.Generator) -> tuple[PlaneChains, float]:
    """Draws of the plane that divides the interior in two, and the log evidence of the shell's thickness.

    Metropolis chains start at random planes, from which they are resampled as the temperature falls to 1 (Del
    Moral, Doucet and Jasra 2006). So they find all modes of the plane's posterior and occupy each in its
    proportion. The evidence, a likelihood of the thickness, is the mean of prior times likelihood over planes
    everywhere: the product of the ratios between successive temperatures.

    Args:
        problem: Measured moments and the body, from which the masses follow, for one shell thickness.
        rng: Random generator.

    Returns:
        Dividing planes with their log posterior: one per chain (`CHAINS`) and step (`KEPT_STEPS`), 2000 in
        all; and the log evidence, up to a constant that all thicknesses share.
    """
    normals = _unit(rng.standard_normal((RANDOM_PLANES, 3)))
    heights = rng.uniform(-0.5, 0.5, RANDOM_PLANES) * problem.reach
    chains = PlaneChains.of_planes(problem.solve(normals, heights, coarsely=True))
    # n and -n are one plane: all normals on one side, so that differences of two chains are meaningful.
    near = normals[int(np.argmax(chains.log_posterior))]

    def solved(normals: Array, heights: Array, *, coarsely: bool = False) -> PlaneChains:
        return PlaneChains.of_planes(problem.solve(*oriented(normals, heights, near), coarsely=coarsely))

    coldness, log_evidence = 0.0, 0.0
    while coldness < 1.0:
        colder = _next_coldness(coldness, chains.log_posterior)
        gain, first = (colder - coldness) * chains.log_posterior, coldness == 0.0
        log_evidence += _log_mean_exp(gain)
        chosen, coldness = _resampled(gain, CHAINS, rng), colder
        chains = chains.selected(chosen)
        if first:
            # With all normals on one side from here on.
            chains = solved(chains.planes.normals, chains.planes.heights, coarsely=True)
        for _ in range(COOLING_MOVES):
            there = solved(*_proposals(chains.planes, problem.reach, rng), coarsely=True)
            chains = _metropolis_step(chains, there, 1.0 / coldness, rng)
    coarse, chains = chains.log_posterior, solved(chains.planes.normals, chains.planes.heights)
    log_evidence += _log_mean_exp(chains.log_posterior - coarse)
    kept: list[PlaneChains] = []
    for _ in range(KEPT_STEPS):
        chains = _metropolis_step(chains, solved(*_proposals(chains.planes, problem.reach, rng)), 1.0, rng)
        kept.append(chains)
    chains = PlaneChains(
        DividingPlanes.concatenate([each.planes for each in kept]),
        np.concatenate([each.log_posterior for each in kept]),
    )
    return chains, log_evidence


def _next_coldness(coldness: float, log_posterior: Array) -> float:
    """Next inverse temperature, up to 1, at which `EFFECTIVE_CHAINS` of n Metropolis chains still count.

    The posterior is raised to the inverse temperature, which grows to 1 in steps. After a step each chain has
    the weight exp(step * log posterior); they count as (sum of weights)^2 / sum of squared weights.

    Args:
        coldness: Present inverse temperature.
        log_posterior: (n,) log posteriors of the chains' planes.
    """

    def effective(colder: float) -> float:
        weight = np.exp((colder - coldness) * (log_posterior - log_posterior.max()))
        return float(weight.sum() ** 2 / np.sum(weight**2))

    low, high = coldness, 1.0
    if effective(high) >= EFFECTIVE_CHAINS:
        return high
    while high - low > max(1e-3 * low, 1e-9):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective(middle) >= EFFECTIVE_CHAINS else (low, middle)
    return high


def _log_mean_exp(values: Array) -> float:
    """Logarithm of the mean of exp(`values`), for `values` (n,) of any size."""
    most = float(values.max())
    return most + float(np.log(np.mean(np.exp(values - most))))


def _metropolis_step(
    chains: PlaneChains, there: PlaneChains, temperature: float, rng: np.random.Generator
) -> PlaneChains:
    """Metropolis chains after one step: each keeps its dividing plane, or takes the one proposed to it.

    Args:
        chains: planes of the b chains, with their log posterior.
        there: the b proposed planes, with their log posterior.
        temperature: 1 samples the posterior; above 1 moves to a lower posterior are accepted more often.
        rng: random generator.
    """
    raised = there.log_posterior + temperature * rng.exponential(size=len(there.log_posterior))
    accept = raised > chains.log_posterior
    return PlaneChains(
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


def oriented(normals: Array, heights: Array, towards: Array) -> tuple[Array, Array]:
    """Normals (b, 3) and heights (b,) [m] of b planes, with all normals on the side of `towards` (3,).

    A plane whose normal points to the other side has the signs of normal and height reversed, and so stays in
    place.
    """
    side = np.where(normals @ towards < 0, -1.0, 1.0)
    return normals * side[:, None], heights * side


def _unit(vectors: Array) -> Array:
    """Unit vectors (b, 3) along `vectors` (b, 3)."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
