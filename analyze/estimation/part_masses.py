"""Masses of the labelled parts of an object, each uniform, from its moments (METHOD section 6, n parts).

What was measured is linear in the parts' masses x: sum x = m, sum x (c_p - c) = 0, sum x l.I_p(c).l = I_c,l. Nothing is lighter than
nothing nor denser than lead: the posterior is a normal distribution cut off there. Where the moments leave a mixture open, it fills what
these bounds allow, and the part is said to be not observed.
"""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from analyze.errors import EstimationError
from analyze.estimation.cut_normal import draw_cut, shortest
from analyze.geometry.object_model import DENSITIES, LEVER_ERROR, MODEL_ERROR
from analyze.geometry.polyhedron import MassProperties
from analyze.types import Array, InertialParameters

_DENSEST = DENSITIES[1]
_CHAINS, _STEPS, _SETTLED = 100, 160, 60
_ALONG_OTHERS = 0.6
"""share of steps along the difference of two other chains, which the bounds have shaped already"""
_ANYWHERE = 2.0
"""sd of a part's mass before anything is measured, over the object's: what the data leave open is bounded by zero and the mass"""
_ABOUT = 2
"""times that the parts' own c is found anew"""
_SIGMAS = 5.0
"""of the object's mass, that no part is heavier than"""
_OPEN = 0.5
"""width of a part's interval over what its bounds leave it, from which on it was not observed"""


@dataclass(frozen=True)
class MeasuredMoments:
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

    def whitening(self) -> tuple[Array, Array]:
        """Matrix (4 + a, 4 + a) that brings (mass, first moment about c, moments) to units of their sd, and these so brought (4 + a,)."""
        target = np.concatenate([[self.mass], np.zeros(3), self.moments])
        covariance = self.covariance.copy()
        # First moments, not c: both their rows and columns are per kilogram of the whole.
        covariance[1:4] *= self.mass
        covariance[:, 1:4] *= self.mass
        size = np.sqrt(np.diag(covariance))
        values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
        whiten = np.asarray((vectors / np.sqrt(np.maximum(values, 1e-9 * values.max()))).T / size, dtype=np.float64)
        return whiten, whiten @ target


@dataclass(frozen=True)
class PartMasses:
    """Posterior of the parts' masses."""

    names: tuple[str, ...]
    masses: Array
    """(n,) kg, means"""
    covariance: Array
    """(n, n) kg^2"""
    intervals: Array
    """(n, 2) kg, the shortest that hold 95 %"""
    observed: tuple[bool, ...]
    volumes: Array
    """(n,) m^3"""
    uniform: Array
    """(n,) kg, the naive answer: one density for all"""
    misfit: float
    """root of the mean squared residual over its sd, at the best masses: far above 1 where the parts cannot explain the moments"""


def measured_moments(parameters: InertialParameters) -> MeasuredMoments:
    """What the strikes measured, with what a uniform part of a drawn shape is off (as for the regions)."""
    mass, moments = parameters.mass, np.array([axis.i_com for axis in parameters.axes])
    model = np.concatenate([[0.0], np.full(3, LEVER_ERROR), MODEL_ERROR * moments])
    directions = np.array([axis.direction for axis in parameters.axes]).reshape(-1, 3)
    return MeasuredMoments(mass, parameters.com.position, directions, moments, parameters.joint_covariance + np.diag(model**2))


def part_masses(moments: MeasuredMoments, names: Sequence[str], parts: Sequence[MassProperties], rng: np.random.Generator) -> PartMasses:
    """Masses of `parts` that explain `moments`.

    Hit-and-run chains (Smith 1984, Operations Research 32) in directions drawn from the unbounded posterior or from other chains (ter Braak
    2006, Statistics and Computing 16), so that what is tightly bound (the sum, a small part) slows nothing down.

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
    most = np.minimum(_DENSEST * volumes, moments.mass + _SIGMAS * math.sqrt(float(moments.covariance[0, 0])))
    prior = np.eye(len(parts)) / (_ANYWHERE * moments.mass) ** 2
    about = moments.com
    for _ in range(_ABOUT):
        likeliest = _likeliest(*_normal(*_whitened(moments, parts, about), prior, uniform), most)
        about = likeliest @ np.array([part.centroid for part in parts]) / likeliest.sum()
    rows, target = _whitened(moments, parts, about)
    mean, precision = _normal(rows, target, prior, uniform)
    likeliest = _likeliest(mean, precision, most)
    draws = _drawn(mean, precision, likeliest, most, rng)
    low, high = shortest(draws, 0.0)
    best = draws[np.argmin(np.sum((draws @ rows.T - target) ** 2, axis=1))]
    return PartMasses(
        names=tuple(names),
        masses=draws.mean(axis=0),
        covariance=np.cov(draws.T),
        intervals=np.stack([low, high], axis=1),
        observed=tuple(bool(part) for part in high - low < _OPEN * most),
        volumes=volumes,
        uniform=uniform,
        misfit=float(np.sqrt(np.mean((rows @ best - target) ** 2))),
    )


def _whitened(moments: MeasuredMoments, parts: Sequence[MassProperties], about: Array) -> tuple[Array, Array]:
    """Design (4 + a, n) per kilogram and target (4 + a,), both in units of the target's sd; moments of inertia about `about` (3,).

    They were measured about the true c, of which the parts' own is a better guess than the measured one: of a slender body m |error of c|^2
    about its length is more than the moment's own error.
    """
    columns = []
    for part in parts:
        arm = part.centroid - about
        inertia = part.unit_inertia + (arm @ arm) * np.eye(3) - np.outer(arm, arm)
        columns.append(
            np.concatenate([[1.0], part.centroid - moments.com, np.einsum("ai,ij,aj->a", moments.directions, inertia, moments.directions)])
        )
    whiten, target = moments.whitening()
    return whiten @ np.array(columns).T, target


def _normal(rows: Array, target: Array, prior: Array, uniform: Array) -> tuple[Array, Array]:
    """Mean (n,) and precision (n, n) without bounds."""
    precision = rows.T @ rows + prior
    return np.asarray(np.linalg.solve(precision, rows.T @ target + prior @ uniform), dtype=np.float64), precision


def _likeliest(mean: Array, precision: Array, most: Array) -> Array:
    """(n,) between 0 and `most` where the normal distribution (mean, precision) is greatest, a little off the bounds."""
    values, vectors = np.linalg.eigh(precision)
    root = (vectors * np.sqrt(values)).T * most
    share = lsq_linear(root, root @ (mean / most), bounds=(0.0, 1.0)).x
    return most * np.clip(share, 1e-6, 1.0 - 1e-6)


def _drawn(mean: Array, precision: Array, start: Array, most: Array, rng: np.random.Generator) -> Array:
    """(draws, n) of the normal distribution (mean, precision) between 0 and `most` (n,)."""
    values, vectors = np.linalg.eigh(precision)
    spread = vectors / np.sqrt(values)
    x = np.tile(start, (_CHAINS, 1))
    halves = np.arange(_CHAINS // 2), np.arange(_CHAINS // 2, _CHAINS)
    kept = []
    for step in range(_STEPS):
        for _ in range(len(mean)):
            for moved, others in (halves, halves[::-1]):
                direction = rng.standard_normal((len(moved), len(mean))) @ spread.T
                if rng.uniform() < _ALONG_OTHERS:
                    pair = rng.choice(others, (2, len(moved)))
                    # Where both are the same, or do not differ yet, the other kind of direction stands.
                    apart = x[pair[0]] - x[pair[1]]
                    direction = np.where(np.any(apart != 0.0, axis=1, keepdims=True), apart, direction)
                x[moved] = _stepped(x[moved], direction, mean, precision, most, rng)
        if step >= _SETTLED:
            kept.append(x.copy())
    return np.concatenate(kept)


def _stepped(x: Array, direction: Array, mean: Array, precision: Array, most: Array, rng: np.random.Generator) -> Array:
    """One draw (m, n) on each line x + t direction between the bounds: there the logarithm is -(b t + a t^2 / 2)."""
    by_precision = direction @ precision
    a = np.sum(by_precision * direction, axis=1)
    b = np.sum(by_precision * (x - mean), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        to_zero, to_most = -x / direction, (most - x) / direction
    low = np.max(np.where(direction > 0, to_zero, np.where(direction < 0, to_most, -np.inf)), axis=1)
    high = np.min(np.where(direction > 0, to_most, np.where(direction < 0, to_zero, np.inf)), axis=1)
    return np.clip(x + draw_cut(-b / a, 1.0 / np.sqrt(a), low, high, rng)[:, None] * direction, 0.0, most)
