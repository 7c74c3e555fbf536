"""Masses of the labelled parts of an object, each uniform, from its moments (METHOD section 6, n parts).

What was measured is linear in the parts' masses x: sum x = m, sum x (c_p - c) = 0, sum x l.I_p(c).l = I_c,l. With x >= 0 the posterior is a
normal distribution cut off at zero; where the moments leave a mixture open, it fills what the mass allows, and the part is said to be not
observed.
"""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from analyze.errors import EstimationError
from analyze.estimation.regions import LEVER_ERROR, MODEL_ERROR
from analyze.geometry.polyhedron import MassProperties
from analyze.types import Array, InertialParameters

_CHAINS, _STEPS, _SETTLED = 200, 120, 40
_ANYWHERE = 2.0
"""sd of a part's mass before anything is measured, over the object's: what the data leave open is bounded by zero and the mass"""
_OPEN = 0.5
"""width of a part's interval over what the mass alone leaves it (0 to m), from which on it was not observed"""


@dataclass(frozen=True)
class Moments:
    """What is known of the whole object: rows of a linear system in masses, with the covariance of their errors."""

    mass: float
    """kg"""
    com: Array
    """(3,) m"""
    directions: Array
    """(a, 3) unit, of the axes through c"""
    moments: Array
    """(a,) kg m^2 about them"""
    covariance: Array
    """(4 + a, 4 + a) of mass, c and the moments"""


@dataclass(frozen=True)
class PartMasses:
    """Posterior of the parts' masses."""

    names: tuple[str, ...]
    masses: Array
    """(n,) kg, means"""
    covariance: Array
    """(n, n) kg^2"""
    intervals: Array
    """(n, 2) kg, 95 %"""
    observed: tuple[bool, ...]
    volumes: Array
    """(n,) m^3"""
    uniform: Array
    """(n,) kg, the naive answer: one density for all"""
    misfit: float
    """root of the mean squared residual over its sd, at the best masses: far above 1 where the parts cannot explain the moments"""


def measured_moments(parameters: InertialParameters) -> Moments:
    """What the strikes measured, with what a uniform part of a drawn shape is off (as for the regions)."""
    mass, moments = parameters.mass, np.array([axis.i_com for axis in parameters.axes])
    model = np.concatenate([[0.0], np.full(3, LEVER_ERROR), MODEL_ERROR * moments])
    directions = np.array([axis.direction for axis in parameters.axes]).reshape(-1, 3)
    return Moments(mass, parameters.com.position, directions, moments, parameters.joint_covariance + np.diag(model**2))


def part_masses(moments: Moments, names: Sequence[str], parts: Sequence[MassProperties], rng: np.random.Generator) -> PartMasses:
    """Masses of `parts` that explain `moments`.

    Hit-and-run chains (Smith 1984, Operations Research 32) in directions drawn from the unbounded posterior, so that what is tightly bound
    (the sum) slows nothing down.

    Args:
        moments: of the whole.
        names: of the parts.
        parts: each one's volume, centroid in O and inertia about it per kilogram.
        rng: for the chains; the same seed gives the same answer.

    Raises:
        EstimationError: fewer than two parts, or one without volume.
    """
    volumes = np.array([part.volume for part in parts])
    if len(parts) < 2 or volumes.min() <= 0:
        raise EstimationError("masses of parts need at least two parts, each with a volume")
    uniform = moments.mass * volumes / volumes.sum()
    rows, target = _whitened(moments, parts)
    precision = rows.T @ rows + np.eye(len(parts)) / (_ANYWHERE * moments.mass) ** 2
    mean = np.linalg.solve(precision, rows.T @ target + uniform / (_ANYWHERE * moments.mass) ** 2)
    draws = _drawn(mean, precision, uniform, rng)
    low, high = np.quantile(draws, [0.025, 0.975], axis=0)
    best = draws[np.argmin(np.sum((draws @ rows.T - target) ** 2, axis=1))]
    return PartMasses(
        names=tuple(names),
        masses=draws.mean(axis=0),
        covariance=np.cov(draws.T),
        intervals=np.stack([low, high], axis=1),
        observed=tuple(bool(width < _OPEN * moments.mass) for width in high - low),
        volumes=volumes,
        uniform=uniform,
        misfit=float(np.sqrt(np.mean((rows @ best - target) ** 2))),
    )


def _whitened(moments: Moments, parts: Sequence[MassProperties]) -> tuple[Array, Array]:
    """Design (4 + a, n) per kilogram and target (4 + a,), both in units of the target's sd."""
    columns = []
    for part in parts:
        arm = part.centroid - moments.com
        inertia = part.unit_inertia + (arm @ arm) * np.eye(3) - np.outer(arm, arm)
        columns.append(np.concatenate([[1.0], arm, np.einsum("ai,ij,aj->a", moments.directions, inertia, moments.directions)]))
    target = np.concatenate([[moments.mass], np.zeros(3), moments.moments])
    covariance = moments.covariance.copy()
    # First moments, not c: both their rows and columns are per kilogram of the whole.
    covariance[1:4] *= moments.mass
    covariance[:, 1:4] *= moments.mass
    size = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    whiten = (vectors / np.sqrt(np.maximum(values, 1e-9 * values.max()))).T / size
    return whiten @ np.array(columns).T, whiten @ target


def _drawn(mean: Array, precision: Array, start: Array, rng: np.random.Generator) -> Array:
    """(draws, n) of the normal distribution (mean, precision) where no part is negative."""
    values, vectors = np.linalg.eigh(precision)
    spread = vectors / np.sqrt(values)
    x = np.tile(np.maximum(start, 1e-3 * start.sum()), (_CHAINS, 1))
    kept = []
    for step in range(_STEPS):
        for _ in range(len(mean)):
            direction = rng.standard_normal(x.shape) @ spread.T
            # Along x + t d the logarithm is -(b t + a t^2 / 2).
            by_precision = direction @ precision
            a = np.sum(by_precision * direction, axis=1)
            b = np.sum(by_precision * (x - mean), axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                bound = -x / direction
            low = np.max(np.where(direction > 0, bound, -np.inf), axis=1)
            high = np.min(np.where(direction < 0, bound, np.inf), axis=1)
            x = np.maximum(x + _cut_normal(-b / a, 1.0 / np.sqrt(a), low, high, rng)[:, None] * direction, 0.0)
        if step >= _SETTLED:
            kept.append(x)
    return np.concatenate(kept)


def _cut_normal(mean: Array, sd: Array, low: Array, high: Array, rng: np.random.Generator) -> Array:
    """One draw each of normal distributions between bounds."""
    from_, to = (low - mean) / sd, (high - mean) / sd
    # In the tail where the distribution function is small, so that differences do not vanish.
    flip = from_ + to > 0
    near, far = np.where(flip, -to, from_), np.where(flip, -from_, to)
    share = ndtr(near) + rng.uniform(size=mean.shape) * (ndtr(far) - ndtr(near))
    drawn = ndtri(np.clip(share, 1e-300, 1.0 - 1e-16))
    return np.clip(mean + sd * np.where(flip, -drawn, drawn), low, high)
