"""Posterior of the plane or ball that divides a body's interior, by Metropolis chains that cool down."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analyze.estimation.dividing_surfaces import Kind, are_balls, balls, oriented, planes
from analyze.estimation.region_problem import RegionProblem, SolvedSurfaces
from analyze.types import Array, IntArray

RANDOM_SURFACES = 3000
"""Number of random planes from which the chains start; half of it for balls."""
RADII = (0.1, 0.6)
"""Smallest and largest radius of a ball over the cube root of the interior's volume. A smaller lump has
nearly the moments of one of the smallest radius; the largest has nearly the interior's volume."""
CHAINS = 200
"""Number of Metropolis chains."""
COOLING_MOVES, KEPT_STEPS = 2, 10
"""Steps of each chain at every temperature while it cools, and at the end, when every position is kept."""
EFFECTIVE_SHARE = 0.5
"""Effective share of the chains (sum of weights squared over sum of squares) at the next temperature."""
DIFFERENCE_MOVES = 0.5
"""Share of the moves along the difference of two other chains, which scales with the mode's width (ter Braak
2006)."""
MOVE_SIZES = (0.02, 0.1, 0.3)
"""Sizes of the other moves: of a plane's angle [rad], of a ball's log radius, and of shifts, over
`MOVE_REACH`."""
MOVE_REACH = 0.3
"""Size of a shift over the body's longest extent, for a move of size 1."""


@dataclass(frozen=True)
class SurfaceChains:
    """Present states of b Metropolis chains (random walks), with the log posterior of each.

    The state of a chain is a plane, or a ball, that divides the body's interior in two uniform parts.
    """

    solved: SolvedSurfaces
    """Position of each chain, with the mass shares that fit it."""
    log_posterior: Array
    """(b,) log posterior, the mass shares integrated out."""

    @classmethod
    def of_surfaces(cls, solved: SolvedSurfaces) -> SurfaceChains:
        """Chains (random walks) at b start surfaces, with the surfaces' log posteriors (b,).

        Each surface, a plane or a ball, divides the body's interior in two. A log posterior is the logarithm,
        up to a constant, of the surface's probability given the measurements; -1e300 for a plane with next to
        nothing of the interior on one side, and for a ball that is mostly outside the interior or fills
        nearly all of it.
        """
        return cls(
            solved, np.where(solved.both_sides_filled, solved.shares.log_mass - solved.chi_square / 2, -1e300)
        )

    def selected(self, chosen: NDArray[Any]) -> SurfaceChains:
        """Chains (random walks over dividing surfaces) with the indices, or the mask, `chosen`."""
        fields = (getattr(self.solved, name)[chosen] for name in self.solved.__dataclass_fields__)
        return SurfaceChains(SolvedSurfaces(*fields), self.log_posterior[chosen])


def surface_posterior(
    problem: RegionProblem, rng: np.random.Generator, kind: Kind
) -> tuple[SurfaceChains, float]:
    """Draws of the surface that divides the interior, and the log evidence of the shell's thickness.

    The surface is a plane between two uniform parts, or a ball: a lump or a void in a uniform remainder,
    which may be empty. Metropolis chains start at random surfaces, from which they are resampled as the
    temperature falls to 1 (Del Moral, Doucet and Jasra 2006). So they find all modes of the posterior and
    occupy each in its proportion. The evidence, a likelihood of the thickness, is the mean of prior times
    likelihood over surfaces everywhere: the product of the ratios between successive temperatures.

    Args:
        problem: Measured moments and the body, from which the masses follow, for one shell thickness.
        rng: Random generator.
        kind: Kind of body: divided by planes, by balls, or by balls with nothing outside.

    Returns:
        Dividing surfaces with their log posterior: one per chain (`CHAINS`) and step (`KEPT_STEPS`), 2000 in
        all; and the log evidence, up to a constant that all thicknesses share.
    """
    start = _random_planes(problem, rng) if kind is Kind.TWO_PARTS else _random_balls(problem, rng)
    alone = kind is Kind.LONE_LUMP
    chains = SurfaceChains.of_surfaces(problem.solve(start, coarsely=True, empty_below=alone))
    # n and -n are one plane: all normals on one side, so that differences of two chains are meaningful.
    near = start[int(np.argmax(chains.log_posterior)), :3]

    def solved(surfaces: Array, *, coarsely: bool = False) -> SurfaceChains:
        return SurfaceChains.of_surfaces(
            problem.solve(oriented(surfaces, near), coarsely=coarsely, empty_below=alone)
        )

    coldness, log_evidence = 0.0, 0.0
    while coldness < 1.0:
        colder = _next_coldness(coldness, chains.log_posterior, EFFECTIVE_SHARE * CHAINS)
        gain, first = (colder - coldness) * chains.log_posterior, coldness == 0.0
        log_evidence += _log_mean_exp(gain)
        chosen, coldness = _resampled(gain, CHAINS, rng), colder
        chains = chains.selected(chosen)
        if first:
            # With all normals on one side from here on.
            chains = solved(chains.solved.surfaces, coarsely=True)
        for _ in range(COOLING_MOVES):
            there = solved(_proposals(chains.solved.surfaces, problem, rng), coarsely=True)
            chains = _metropolis_step(chains, there, 1.0 / coldness, rng)
    coarse, chains = chains.log_posterior, solved(chains.solved.surfaces)
    log_evidence += _log_mean_exp(chains.log_posterior - coarse)
    kept: list[SurfaceChains] = []
    for _ in range(KEPT_STEPS):
        there = solved(_proposals(chains.solved.surfaces, problem, rng))
        chains = _metropolis_step(chains, there, 1.0, rng)
        kept.append(chains)
    chains = SurfaceChains(
        SolvedSurfaces.concatenate([each.solved for each in kept]),
        np.concatenate([each.log_posterior for each in kept]),
    )
    return chains, log_evidence


def _random_planes(problem: RegionProblem, rng: np.random.Generator) -> Array:
    """Random planes through the body, as `RANDOM_SURFACES` rows (b, 5), to start Metropolis chains from.

    A row holds unit normal (3), height over the body's middle [m], and 0. Normals are uniform over all
    directions, heights over a range around 0 as long as the body's longest extent.
    """
    heights = rng.uniform(-0.5, 0.5, RANDOM_SURFACES) * problem.reach
    return planes(_unit(rng.standard_normal((RANDOM_SURFACES, 3))), heights)


def _random_balls(problem: RegionProblem, rng: np.random.Generator) -> Array:
    """Random balls, as `RANDOM_SURFACES` / 2 rows (b, 5), to start Metropolis chains from.

    A row holds n (3), h [m] and k [1/m]: the ball's points x, in m from the body's middle, have n.x - h - k
    |x|^2 / 2 > 0. Centres are uniform in the interior's volume. Radii are uniform in their logarithm, from
    0.1 to 0.6 (`RADII`) of the cube root of that volume.
    """
    low, high = np.log(problem.interior_size * np.array(RADII))
    radii = np.exp(rng.uniform(low, high, RANDOM_SURFACES // 2))
    return balls(problem.random_points(len(radii), rng), radii)


def _next_coldness(coldness: float, log_posterior: Array, least: float) -> float:
    """Next inverse temperature, up to 1, at which `least` of n Metropolis chains still count.

    The posterior is raised to the inverse temperature, which grows to 1 in steps. After a step each chain has
    the weight exp(step * log posterior); they count as (sum of weights)^2 / sum of squared weights.

    Args:
        coldness: Present inverse temperature.
        log_posterior: (n,) log posteriors of the chains' surfaces.
        least: Effective number of chains.
    """

    def effective(colder: float) -> float:
        weight = np.exp((colder - coldness) * (log_posterior - log_posterior.max()))
        return float(weight.sum() ** 2 / np.sum(weight**2))

    low, high = coldness, 1.0
    if effective(high) >= least:
        return high
    while high - low > max(1e-3 * low, 1e-9):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if effective(middle) >= least else (low, middle)
    return high


def _log_mean_exp(values: Array) -> float:
    """Logarithm of the mean of exp(`values`), for `values` (n,) of any size."""
    most = float(values.max())
    return most + float(np.log(np.mean(np.exp(values - most))))


def _metropolis_step(
    chains: SurfaceChains, there: SurfaceChains, temperature: float, rng: np.random.Generator
) -> SurfaceChains:
    """Metropolis chains after one step: each keeps its dividing surface, or takes the one proposed to it.

    Args:
        chains: surfaces of the b chains, with their log posterior.
        there: the b proposed surfaces, with their log posterior.
        temperature: 1 samples the posterior; above 1 moves to a lower posterior are accepted more often.
        rng: random generator.
    """
    raised = there.log_posterior + temperature * rng.exponential(size=len(there.log_posterior))
    accept = raised > chains.log_posterior
    return SurfaceChains(
        chains.solved.replaced_where(accept, there.solved),
        np.where(accept, there.log_posterior, chains.log_posterior),
    )


def _proposals(surfaces: Array, problem: RegionProblem, rng: np.random.Generator) -> Array:
    """Proposed surfaces (b, 5) for b Metropolis chains: planes for planes, balls for balls.

    Planes are turned and shifted at random, balls shifted and scaled; a proposal and its reverse are equally
    likely. A share `DIFFERENCE_MOVES` of them moves by the difference of two other chains. A ball whose
    radius would leave the range `RADII` stays.

    Args:
        surfaces: (b, 5) present positions of the chains, all planes or all balls: n (3), h [m] and k [1/m] of
            the surface n.x - h - k |x|^2 / 2 = 0, with x in m from the body's middle.
        problem: Measured moments and the body, whose size scales the shifts.
        rng: Random generator.
    """
    many, shift = len(surfaces), MOVE_REACH * problem.reach
    size = rng.choice(MOVE_SIZES, size=many)[:, None]
    first, second = rng.integers(many, size=(2, many))
    along = rng.uniform(size=(many, 1)) < DIFFERENCE_MOVES
    if not are_balls(surfaces).any():
        state = surfaces[:, :4]
        move = size * np.array([1.0, 1.0, 1.0, shift]) * rng.standard_normal((many, 4))
        state = state + np.where(along, state[first] - state[second] + 0.05 * move, move)
        return planes(_unit(state[:, :3]), state[:, 3])
    radii = 1.0 / surfaces[:, 4:]
    state = np.hstack([surfaces[:, :3] * radii, np.log(radii)])
    move = size * np.array([shift, shift, shift, 1.0]) * rng.standard_normal((many, 4))
    state = state + np.where(along, state[first] - state[second] + 0.05 * move, move)
    low, high = np.log(problem.interior_size * np.array(RADII))
    within = (low < state[:, 3:]) & (state[:, 3:] < high)
    return np.where(within, balls(state[:, :3], np.exp(np.clip(state[:, 3], low, high))), surfaces)


def _resampled(log_weight: Array, count: int, rng: np.random.Generator) -> IntArray:
    """Indices (count,) of `log_weight`, drawn in proportion to exp(`log_weight`) by systematic resampling."""
    weight = np.exp(log_weight - log_weight.max())
    edges = np.cumsum(weight) / weight.sum()
    return np.minimum(np.searchsorted(edges, (np.arange(count) + rng.uniform()) / count), len(weight) - 1)


def _unit(vectors: Array) -> Array:
    """Unit vectors (b, 3) along `vectors` (b, 3)."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
