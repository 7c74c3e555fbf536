"""Test of strikes over one edge at several energies: do they share phi and k, as those of a rigid body?

phi is the balance angle, k the rate constant of the tip. Contents that move reach their new place in a slow
tip and lag behind a fast one: phi rises with the energy, and k changes. The statistic is the scatter of (phi,
ln k) about the means of the edges; errors that strikes over one edge share drop out of it.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc, stdtr

from analyze.estimation.detection import critical_value, noncentrality
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.types import Array, EquiPlane

K_SCATTER = 5e-3
"""Relative 1 sigma of k from strike to strike beyond the error of its fit."""
TREND_PROBABILITY = 0.05
"""Probability by chance up to which phi counts as rising with the energy, among strikes that scatter."""
K_PROBABILITY, SURE_K_PROBABILITY = 0.01, 1e-5
"""Probabilities by chance up to which k counts as scattering, which no turn of the object at rest explains:
with a rise of phi, and without one."""
TURN_PER_SHARE = 0.2
"""Rise of phi [rad] with the logarithm of the energy by a liquid, per share of the mass, at a width of the
body across the edge equal to the distance of c from it: what nine of ten simulated liquids reach."""


@dataclass(frozen=True)
class EdgeScatter:
    """Strikes over one edge in one way: do they share phi and k?"""

    axis_id: str
    """Id of the pivot axis."""
    strike_ids: tuple[str, ...]
    """Ids of the strikes, from the least energy to the greatest."""
    energy_ratios: tuple[float, ...]
    """Their energy ratios: energy of the strike over the energy needed to reach balance."""
    phi_change: float
    """Phi at the greatest energy less that at the least [rad], by the slope over its logarithm."""
    k_change: float
    """The same change of ln k."""
    chi_squared: float
    """Scatter of (phi, ln k) about their mean, in units of the variances."""
    freedom: int
    """Its degrees of freedom."""

    @property
    def probability(self) -> float:
        """Probability of such a scatter by chance."""
        return float(chdtrc(self.freedom, self.chi_squared))


@dataclass(frozen=True)
class EnergyTest:
    """Test of all edges together: do phi and k of the strikes over an edge depend on their energy?"""

    edges: tuple[EdgeScatter, ...]
    """Edges that were struck more than once in one way, in the order of their first strikes."""
    chi_squared: float
    """Scatter of (phi, ln k) about the means of the edges, in units of the variances."""
    freedom: int
    """Its degrees of freedom; 0: no test."""
    limit: float
    """Value that chance exceeds at the false-alarm probability."""
    trend: float
    """Rise of phi [rad] with the logarithm of the energy, common to all edges."""
    trend_probability: float
    """Probability of a greater rise by chance, by the scatter of the strikes about it (Student's t)."""
    k_probability: float
    """Probability of a greater scatter of ln k by chance."""
    share: float
    """Smallest share of a liquid in the mass that would exceed `limit` in nine of ten cases; infinite without
    a test."""

    @property
    def moves(self) -> bool:
        """True if strikes differ as contents that lag behind a fast tip make them differ.

        Poses at rest that differ from strike to strike move phi as well, but neither k nor, as a rule, with
        the energy.
        """
        rises = self.trend > 0 and (
            self.trend_probability < TREND_PROBABILITY or self.k_probability < K_PROBABILITY
        )
        return self.chi_squared > self.limit and (rises or self.k_probability < SURE_K_PROBABILITY)

    @property
    def unexplained(self) -> bool:
        """True if strikes over one edge differ, but not as contents that lag behind make them differ."""
        return self.chi_squared > self.limit and not self.moves


def energy_test(
    planes: Sequence[EquiPlane], energy: Array, com: Array, systematic: SystematicErrors, prior: ComPrior
) -> EnergyTest:
    """Test of all edges that were struck more than once in one way.

    Args:
        planes: Equi-planes (through pivot line and centre of mass c) of the strikes used, in the object frame
            O, with balance angles phi and rate constants k.
        energy: (strikes,) energy ratios: energy of a strike over the energy needed to reach balance.
        com: (3,) c [m] by all strikes together, in O.
        systematic: Standard deviation of the usual scatter of phi.
        prior: Prior of c; its sd are half the extents of the body.
    """
    groups: dict[tuple[str, float, int], list[int]] = {}
    for i, plane in enumerate(planes):
        if plane.k is not None and plane.sd_k:
            groups.setdefault((plane.axis_id, plane.heading, plane.level), []).append(i)
    sorted_groups = [sorted(each, key=lambda i: energy[i]) for each in groups.values() if len(each) > 1]
    if not sorted_groups:
        return EnergyTest((), 0.0, 0, math.inf, 0.0, 1.0, 1.0, math.inf)
    found = [
        _edge_figures([planes[i] for i in each], energy[each], com, systematic, prior)
        for each in sorted_groups
    ]
    chi_squared = sum(each.edge.chi_squared for each in found)
    freedom = sum(each.edge.freedom for each in found)
    limit = critical_value(freedom)
    run, rise = (np.concatenate([getattr(each, name) for each in found]) for name in ("run", "rise"))
    length = max(float(run @ run), 1e-12)
    trend = float(run @ rise) / length
    left = freedom // 2 - 1
    scatter = math.sqrt(max(float(np.sum((rise - trend * run) ** 2)), 1e-12) / max(left, 1))
    power = sum(each.power for each in found)
    return EnergyTest(
        edges=tuple(each.edge for each in found),
        chi_squared=chi_squared,
        freedom=freedom,
        limit=limit,
        trend=trend,
        trend_probability=1.0 - float(stdtr(left, trend * math.sqrt(length) / scatter)) if left > 0 else 1.0,
        k_probability=float(chdtrc(freedom // 2, sum(each.k_chi_squared for each in found))),
        share=math.sqrt(noncentrality(limit, freedom) / max(power, 1e-12)),
    )


@dataclass(frozen=True)
class _EdgeFigures:
    """Figures of one edge that enter the test of all."""

    edge: EdgeScatter
    k_chi_squared: float
    """Scatter of ln k about its mean, in units of its variances."""
    run: Array
    """(strikes,) logarithms of the energy less their mean, over the sd of phi."""
    rise: Array
    """(strikes,) phi less its mean, over its sd."""
    power: float
    """Noncentrality of the scatter by a liquid, per squared share of the mass."""


def _edge_figures(
    planes: Sequence[EquiPlane], energy: Array, com: Array, systematic: SystematicErrors, prior: ComPrior
) -> _EdgeFigures:
    """Figures of the strikes over one edge, in the order of their energy ratios `energy` (strikes,)."""
    n, plane = len(planes), planes[0]
    values = np.array([[each.phi, math.log(each.k or 1.0)] for each in planes])
    covariance = _own_covariance(planes, systematic.strike_angle_sd)
    log_energy = np.log(energy)
    run = log_energy - log_energy.mean()
    change = run @ values / max(float(run @ run), 1e-12) * float(np.ptp(log_energy))
    # A liquid's effect on phi grows with the energy; that on k is left out, which is cautious.
    arm = com - plane.point
    distance = float(np.linalg.norm(arm - plane.direction * (arm @ plane.direction)))
    width = 2 * float(np.abs(np.cross(plane.direction, plane.up)) @ prior.sd)
    effect = np.zeros((n, 2))
    effect[:, 0] = TURN_PER_SHARE * width / max(distance, 1e-3) * run
    edge = EdgeScatter(
        axis_id=plane.axis_id,
        strike_ids=tuple(each.strike_id for each in planes),
        energy_ratios=tuple(energy.tolist()),
        phi_change=float(change[0]),
        k_change=float(change[1]),
        chi_squared=_scatter(values.ravel(), np.tile(np.eye(2), (n, 1)), covariance),
        freedom=2 * (n - 1),
    )
    sd = np.sqrt(np.diag(covariance)[::2])
    centred = (values[:, 0] - sd**-2 @ values[:, 0] / np.sum(sd**-2)) / sd
    weighted_run = (log_energy - sd**-2 @ log_energy / np.sum(sd**-2)) / sd
    return _EdgeFigures(
        edge,
        _scatter(values[:, 1], np.ones((n, 1)), covariance[1::2, 1::2]),
        weighted_run,
        centred,
        _scatter(effect.ravel(), np.tile(np.eye(2), (n, 1)), covariance),
    )


def _own_covariance(planes: Sequence[EquiPlane], scatter_sd: float) -> Array:
    """Covariance (2n, 2n) of (phi [rad], ln k) of n strikes over one edge, strike by strike.

    It holds the errors in which the strikes differ: those of their fits, their usual scatter, and those of
    their turns at rest.
    """
    n = len(planes)
    found = np.zeros((2 * n, 2 * n))
    for i, plane in enumerate(planes):
        k, sd_k = plane.k or 1.0, plane.sd_k or 0.0
        mixed = plane.cov_phi_k / k
        own = [[plane.sd_phi**2 + scatter_sd**2, mixed], [mixed, (sd_k / k) ** 2 + K_SCATTER**2]]
        found[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = own
    if all(plane.phi_by_rest is not None for plane in planes):
        turns = np.array([plane.phi_by_rest for plane in planes], dtype=np.float64)
        found[::2, ::2] += turns @ turns.T
    return found


def _scatter(values: Array, means: Array, covariance: Array) -> float:
    """Chi^2 of values (m,) about their generalised least-squares means.

    Args:
        values: (m,) values.
        means: (m, p) derivatives of the values by the p means.
        covariance: (m, m) covariance of the values.
    """
    weighted = np.linalg.solve(covariance, np.column_stack([means, values]))
    mean = np.linalg.solve(means.T @ weighted[:, :-1], means.T @ weighted[:, -1])
    return max(float((values - means @ mean) @ (weighted[:, -1] - weighted[:, :-1] @ mean)), 0.0)
