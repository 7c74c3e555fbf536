"""Where in the body the mass may be, cell by cell: the evenest distribution that has the measured moments (METHOD section 6).

Ten moments do not determine thousands of cells. What stands here is what they add to a prior: bounded maximum entropy (Jaynes 1957,
Physical Review 106; bounds as in Fermi statistics), between nothing and the densest stuff, around one density for all. Each cell's density
is then

    rho_v = rho_max / (1 + exp(-(a + lambda . f_v)))

with f_v what a kilogram there adds to the moments and as many lambda as there are moments. What they leave open stays with the map: the
share of each octant's mass that the moments determine, and the number of directions they fix at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.part_masses import MeasuredMoments
from analyze.geometry.object_model import DENSITIES
from analyze.types import Array

if TYPE_CHECKING:
    from analyze.estimation.cells import Cells

_NEWTON = 60
_CONVERGED = 1e-9
_STIFF = 1e3
"""entropy's weight against chi^2 at first, in units of one moment's; halved until the moments are met"""
_HALVINGS = 40
_MET = 1.0
"""rms of the moments' residuals over their sd"""


@dataclass(frozen=True)
class VoxelMap:
    """A density for every cell, and how little of it was measured."""

    points: Array
    """(n, 3) m, in O"""
    volumes: Array
    """(n,) m^3"""
    density: Array
    """(n,) kg/m^3"""
    prior: float
    """kg/m^3, of all cells before anything was measured"""
    octants: Array
    """(8,) kg, masses on the eight sides of the planes through the body's middle across O's axes"""
    determined: Array
    """(8,) 0 to 1: share of each octant's variance under the prior that the moments take away"""
    directions: int
    """that the moments fix, of n"""
    misfit: float
    """rms of the moments' residuals over their sd; far above 1: no distribution between the bounds has these moments"""


def voxel_map(moments: MeasuredMoments, cells: Cells) -> VoxelMap:
    """The evenest map between nothing and the densest stuff with these moments.

    Args:
        moments: of the whole.
        cells: the body; wall and interior are not told apart.
    """
    volumes = cells.volumes
    features, target = _whitened(moments, cells)
    prior = min(moments.mass / float(volumes.sum()), 0.5 * DENSITIES[1])
    offset = float(np.log(prior / (DENSITIES[1] - prior)))
    most = DENSITIES[1] * volumes
    multipliers, stiffness = np.zeros(features.shape[1]), _STIFF
    masses, misfit = most, math.inf
    for _ in range(_HALVINGS):
        multipliers = _solved(multipliers, features, target, most, offset, stiffness)
        masses = _masses(multipliers, features, most, offset)
        misfit = float(np.sqrt(np.mean((features.T @ masses - target) ** 2)))
        if misfit <= _MET:
            break
        stiffness /= 2
    spread = masses * (1.0 - masses / most)
    octant = np.asarray((cells.points > cells.centroid).astype(np.int64) @ np.array([1, 2, 4]), dtype=np.int64)
    inside = np.asarray(np.arange(8)[:, None] == octant, dtype=np.float64)
    before = inside @ spread
    # Prior covariance diag(spread); what the moments take away of an octant's.
    with_moments = inside @ (spread[:, None] * features)
    curvature = features.T @ (spread[:, None] * features)
    solved: Array = np.asarray(np.linalg.solve(curvature + stiffness * np.eye(len(curvature)), with_moments.T), dtype=np.float64)
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


def _whitened(moments: MeasuredMoments, cells: Cells) -> tuple[Array, Array]:
    """What a kilogram in each cell adds (n, 4 + a) and the target (4 + a,), both in units of the target's sd."""
    arm = cells.points - moments.com
    square = np.sum(arm**2, axis=1) + cells.own
    about = square[:, None] - (arm @ moments.directions.T) ** 2
    rows = np.column_stack([np.ones(len(arm)), arm, about])
    whiten, target = moments.whitening()
    return rows @ whiten.T, target


def _masses(multipliers: Array, features: Array, most: Array, offset: float) -> Array:
    return most / (1.0 + np.exp(-np.clip(offset + features @ multipliers, -500, 500)))


def _solved(start: Array, features: Array, target: Array, most: Array, offset: float, stiffness: float) -> Array:
    """Multipliers (k,) at the least of the dual, by Newton: sum m_max log(1 + exp(a + lambda.f)) - lambda.t + stiffness lambda^2 / 2."""

    def dual(multipliers: Array) -> float:
        lifted = offset + features @ multipliers
        return float(most @ np.logaddexp(0.0, lifted) - multipliers @ target + 0.5 * stiffness * multipliers @ multipliers)

    found, value = start, dual(start)
    for _ in range(_NEWTON):
        masses = _masses(found, features, most, offset)
        gradient = features.T @ masses - target + stiffness * found
        curvature = features.T @ ((masses * (1.0 - masses / most))[:, None] * features) + stiffness * np.eye(len(found))
        step = -np.linalg.solve(curvature, gradient)
        share = 1.0
        while share > 1e-6 and dual(found + share * step) > value + 1e-4 * share * float(gradient @ step):
            share /= 2
        found = found + share * step
        before, value = value, dual(found)
        if before - value <= _CONVERGED * max(1.0, abs(value)):
            break
    return found
