"""Density by cell, of maximum entropy with the measured moments (docs/explanation/method.md, 6).

Ten moments do not determine thousands of cells. They update a prior of bounded maximum entropy (Jaynes 1957,
Physical Review 106; bounds as in Fermi statistics), between zero and the density of lead, around one density
for all cells. The density of each cell is then

    rho_v = rho_max / (1 + exp(-(a + lambda . f_v)))

with rho_max the density of lead, a the logit of the prior density over it, f_v the contribution of a kilogram
in cell v to the moments, and lambda one Lagrange multiplier per moment.
The map also states how little that is: for each octant of the body, the share of its mass's prior variance
that the moments remove, and the number of directions in the space of cell masses that they determine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.part_masses import MeasuredMoments
from analyze.geometry.plausible_size import DENSITIES
from analyze.types import Array

if TYPE_CHECKING:
    from analyze.estimation.cells import Cells

_MAX_NEWTON_STEPS = 60
"""Largest number of Newton steps."""
_CONVERGED_DECREASE = 1e-9
"""Relative decrease of the dual at which Newton's method stops."""
_INITIAL_STIFFNESS = 1e3
"""Initial weight of the entropy against chi^2; halved until the moments are met."""
_MAX_HALVINGS = 40
"""Largest number of these halvings."""
_MAX_MISFIT = 1.0
"""Rms of the standardised residuals at which the moments count as met."""


@dataclass(frozen=True)
class VoxelMap:
    """Density [kg/m^3] of each of n cells of a body, and how far the measured moments determine it.

    How far is stated for the body's octants, formed by three planes through its centroid: the share (0 to 1)
    of the prior variance of an octant's mass that the moments remove. Moments are mass, centre of mass and
    moments of inertia.
    """

    points: Array
    """(n, 3) centroids of the cells [m], in the object frame O."""
    volumes: Array
    """(n,) volumes of the cells [m^3]."""
    density: Array
    """(n,) densities [kg/m^3]."""
    prior: float
    """Prior density of all cells [kg/m^3]."""
    octants: Array
    """(8,) masses [kg] of the octants formed by the planes through the body's centroid normal to O's axes;
    octant number 1 for x + 2 for y + 4 for z above the centroid."""
    determined: Array
    """(8,) share of each octant's prior variance that the moments remove, 0 to 1."""
    directions: int
    """Number of directions in the n-dimensional space of cell masses that the moments determine."""
    misfit: float
    """Rms of the standardised residuals; far above 1 if no densities within the bounds have these moments."""


def voxel_map(moments: MeasuredMoments, cells: Cells) -> VoxelMap:
    """Densities of a body's cells, between zero and lead, that have the measured moments.

    Of all such densities, those of maximum entropy.

    Args:
        moments: Measured mass, centre of mass and moments of the whole object.
        cells: Cells of the body; shell and interior are treated alike.

    Returns:
        Density of every cell [kg/m^3]; the misfit (rms of the moments' standardised residuals), which is
        above `_MAX_MISFIT` if no such densities exist; the masses of the body's octants, and the shares of
        their prior variances that the moments remove.
    """
    volumes = cells.volumes
    # Whitened contributions of a kilogram in each cell, and whitened measurements.
    whiten, target = moments.whitening()
    features = moments.by_cell(cells, moments.com) @ whiten.T
    prior = min(moments.mass / float(volumes.sum()), 0.5 * DENSITIES[1])
    offset = float(np.log(prior / (DENSITIES[1] - prior)))
    most = DENSITIES[1] * volumes
    multipliers, stiffness = np.zeros(features.shape[1]), _INITIAL_STIFFNESS
    masses, misfit = most, math.inf
    for _ in range(_MAX_HALVINGS):
        multipliers = _minimised_dual(multipliers, features, target, most, offset, stiffness)
        masses = _masses(multipliers, features, most, offset)
        misfit = float(np.sqrt(np.mean((features.T @ masses - target) ** 2)))
        if misfit <= _MAX_MISFIT:
            break
        stiffness /= 2
    spread = masses * (1.0 - masses / most)
    octant = (cells.points > cells.centroid).astype(np.int64) @ np.array([1, 2, 4])
    inside = np.asarray(np.arange(8)[:, None] == octant, dtype=np.float64)
    before = inside @ spread
    # Prior covariance diag(spread), and the part of each octant's variance that the moments remove.
    with_moments = inside @ (spread[:, None] * features)
    curvature = features.T @ (spread[:, None] * features)
    solved: Array = np.asarray(
        np.linalg.solve(curvature + stiffness * np.eye(len(curvature)), with_moments.T), dtype=np.float64
    )
    taken = np.sum(with_moments * solved.T, axis=1)
    return VoxelMap(
        points=cells.points,
        volumes=volumes,
        density=masses / volumes,
        prior=prior,
        octants=inside @ masses,
        determined=np.clip(taken / np.maximum(before, 1e-30), 0.0, 1.0),
        directions=int(np.sum(np.linalg.eigvalsh(curvature) > stiffness)),
        misfit=misfit,
    )


def _masses(multipliers: Array, features: Array, most: Array, offset: float) -> Array:
    """Masses (n,) [kg] of the cells: most / (1 + exp(-(offset + features . multipliers))).

    Args:
        multipliers: (k,) Lagrange multipliers, one per measured moment.
        features: (n, k) whitened contributions of a kilogram in each cell to the moments.
        most: (n,) largest masses [kg], those at the density of lead.
        offset: Logit of the prior density over that of lead.
    """
    return most / (1.0 + np.exp(-np.clip(offset + features @ multipliers, -500, 500)))


def _minimised_dual(
    start: Array, features: Array, target: Array, most: Array, offset: float, stiffness: float
) -> Array:
    """Multipliers lambda (k,) that minimise the dual of the maximum-entropy problem, by Newton's method.

    The dual is S - lambda.t + stiffness |lambda|^2 / 2, with S the sum of m_max log(1 + exp(a + lambda.f))
    over the n cells. There is one multiplier for each of the k measured moments.

    Args:
        start: (k,) multipliers to start from.
        features: (n, k) f, contributions of a kilogram in each cell (small cube) to the moments, whitened
            (scaled to independent errors of sd 1).
        target: (k,) t, measured moments, whitened likewise.
        most: (n,) m_max, masses of the cells at the density of lead [kg].
        offset: a, logit of the prior density over that of lead.
        stiffness: Weight of the entropy against chi^2; the smaller, the closer the moments are met.
    """

    def dual(multipliers: Array) -> float:
        lifted = offset + features @ multipliers
        return float(
            most @ np.logaddexp(0.0, lifted)
            - multipliers @ target
            + 0.5 * stiffness * multipliers @ multipliers
        )

    found, value = start, dual(start)
    for _ in range(_MAX_NEWTON_STEPS):
        masses = _masses(found, features, most, offset)
        gradient = features.T @ masses - target + stiffness * found
        curvature = features.T @ ((masses * (1.0 - masses / most))[:, None] * features) + stiffness * np.eye(
            len(found)
        )
        step = -np.linalg.solve(curvature, gradient)
        share = 1.0
        while share > 1e-6 and dual(found + share * step) > value + 1e-4 * share * float(gradient @ step):
            share /= 2
        found = found + share * step
        before, value = value, dual(found)
        if before - value <= _CONVERGED_DECREASE * max(1.0, abs(value)):
            break
    return found
