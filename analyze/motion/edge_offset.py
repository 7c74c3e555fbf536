"""Offset of the followed point from the line about which the body turns, while that line creeps.

The camera follows the point of the object where the pivot line is assumed to be. If that point is off the
true line by d, rotation moves it by (R(theta) - 1) d, with R(theta) the rotation by the tipping angle theta.
The line itself moves too: under the impact an edge hops by some tenths of a millimetre, and a soft contact
sinks and creeps by some hundredths as its load changes. These motions are smooth in theta, as is that of an
offset, so that part of them passes for an offset. They are therefore errors that neighbouring frames share: a
Gaussian process over theta, whose size is averaged over what the measured motion makes likely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.least_squares.robust import huber_weights, median_scale

if TYPE_CHECKING:
    from analyze.types import Array

_CREEP_SIZES = 1e-6 * np.array([7.5, 15.0, 30.0, 60.0, 120.0, 240.0, 480.0])
"""(7,) standard deviations [m] of the line's own motion that are tried

All are equally likely before the measurement where an offset is to be distinguished from that motion: a soft
contact must not pass for an offset. Where the size of the motion itself is estimated, each is a quarter as
likely as one of half the size, so that 17 um (a hard table) are expected where the camera shows nothing.
"""
_CREEP_ANGLE = 0.25
"""tipping angle [rad] over which the line's own motion changes, as the load on the contact does"""
_ROUGH_SHARE, _ROUGH_ANGLE = 0.1, 0.3
"""share of the variance of that motion that is not smooth (hop, stick and slip), and the tipping angle [rad]
over which it loses its memory"""
_MAX_GROUPS = 80
"""largest number of groups into which consecutive frames are averaged"""
_OUTLIER_SIGMAS = 3.0
"""threshold of Huber's weights"""
_ROUNDS = 3
"""number of solutions by which the robust weights are found"""


def displacement_per_offset(theta: Array) -> Array:
    """Displacement (n, 2, 2) of a point by rotations theta (n,) [rad], per metre of offset from the edge.

    Rows: displacement along and off the table; columns: offset along and off the table.
    """
    sin, turned = np.sin(theta), np.cos(theta) - 1.0
    return np.stack([np.stack([turned, sin], axis=-1), np.stack([-sin, turned], axis=-1)], axis=-2)


def displacement_per_error(theta: Array) -> Array:
    """Displacement (n, 2, 3) of a point by rotations theta (n,) [rad], per metre of three edge errors.

    Rows: displacement along and off the table; columns: the point's offset from the edge along and off the
    table, and the edge's radius beyond the assumed one, on which it rolls farther than was subtracted.
    """
    rolled = np.stack([theta, np.zeros_like(theta)], axis=-1)
    return np.concatenate([displacement_per_offset(theta), rolled[..., None]], axis=-1)


@dataclass(frozen=True)
class CreepFit:
    """Result of fitting a pivot line's displacements by a linear model and a smooth motion of its own."""

    parameters: Array
    """(p,) parameters of the model, each in its own unit"""
    covariance: Array
    """(p, p) covariance of the parameters"""
    size: float
    """expected root mean square [m] of the line's own motion"""


def fit_creeping(theta: Array, rows: Array, seen: Array, sd: Array, prior_sd: Array) -> CreepFit:
    """Fit a linear model of a pivot line's displacements; its errors are noise and the line's own motion.

    The own motion is smooth in the tipping angle.

    Args:
        theta: (n,) tipping angle [rad].
        rows: (c, n, p) derivatives by p parameters of the displacement in c directions and n frames.
        seen: (c, n) measured displacements [m].
        sd: (n,) standard deviation of their noise [m].
        prior_sd: (p,) standard deviations of the parameters about 0 before the measurement; infinite for
            parameters without a prior.

    Returns:
        Parameters and covariance, averaged over the likely sizes of the line's own motion, and that size [m].
    """
    found = _averaged(theta, rows, seen, sd, np.ones(seen.shape), prior_sd)
    for _ in range(_ROUNDS - 1):
        left = np.abs(seen - rows @ found.parameters) / np.hypot(sd, found.size)
        weight = huber_weights(left, _OUTLIER_SIGMAS, max(1.0, median_scale(left.ravel())))
        found = _averaged(theta, rows, seen, sd, weight, prior_sd)
    return found


def creep_covariance(theta: Array) -> Array:
    """Covariance (n, n) of a pivot line's own motion at n tipping angles [rad], over its squared size.

    The size is the standard deviation [m] of the motion's smooth part; a rough part is added.
    """
    apart = np.abs(theta[:, None] - theta)
    smooth, rough = np.exp(-0.5 * (apart / _CREEP_ANGLE) ** 2), np.exp(-apart / _ROUGH_ANGLE)
    return smooth + _ROUGH_SHARE * rough


def _averaged(theta: Array, rows: Array, seen: Array, sd: Array, weight: Array, prior_sd: Array) -> CreepFit:
    """Fit of displacements of a pivot line, averaged over the sizes of its own motion by their likelihood.

    Args:
        theta: (n,) tipping angle [rad].
        rows: (c, n, p) derivatives of the displacement in c directions by the p parameters.
        seen: (c, n) measured displacements [m].
        sd: (n,) standard deviation of their noise [m].
        weight: (c, n) robust weights.
        prior_sd: (p,) standard deviations of the parameters about 0 before the measurement.

    Returns:
        Parameters, their covariance, and the expected rms size [m] of the line's own motion.
    """
    groups = np.array_split(np.arange(len(theta)), min(_MAX_GROUPS, len(theta)))
    share = weight / sd**2
    total = np.stack([share[:, group].sum(axis=1) for group in groups], axis=-1)
    mean = [share[:, group] / share[:, group].sum(axis=1, keepdims=True) for group in groups]
    A = np.stack([np.einsum("cg,cgp->cp", m, rows[:, g]) for m, g in zip(mean, groups, strict=True)], axis=1)
    y = np.stack([np.sum(m * seen[:, g], axis=1) for m, g in zip(mean, groups, strict=True)], axis=-1)
    middle = np.array([float(np.mean(theta[group])) for group in groups])
    shape = creep_covariance(middle)
    prior = np.diag(1.0 / np.square(prior_sd))
    solved = [_solve(A, y, total, size * size * shape, prior) for size in _CREEP_SIZES]
    likely = np.array([each[2] for each in solved])
    likely = np.exp(likely - likely.max())
    likely /= likely.sum()
    found = np.asarray(sum(p * x for p, (x, _, _) in zip(likely, solved, strict=True)))
    spread = [cov + np.outer(x - found, x - found) for x, cov, _ in solved]
    covariance = np.asarray(sum(p * each for p, each in zip(likely, spread, strict=True)))
    expected = likely / _CREEP_SIZES**2
    return CreepFit(found, covariance, math.sqrt(float(np.sum(likely) / np.sum(expected))))


def _solve(A: Array, y: Array, total: Array, creep: Array, prior: Array) -> tuple[Array, Array, float]:
    """Generalised least squares of a pivot line's displacements in c directions.

    Args:
        A: (c, m, p) derivatives of the displacements by the p parameters, in m groups of frames.
        y: (c, m) displacements [m].
        total: (c, m) inverse variance of their noise [1/m^2].
        creep: (m, m) covariance of the line's own motion [m^2].
        prior: (p, p) inverse of the parameters' prior covariance; the prior's mean is 0.

    Returns:
        Parameters (p,), covariance (p, p), and the logarithm of the evidence (probability of the
        displacements for this `creep`, up to a factor).
    """
    normal, right, misfit, log_det = prior.copy(), np.zeros(A.shape[2]), 0.0, 0.0
    for rows, seen, inverse in zip(A, y, total, strict=True):
        lower = np.linalg.cholesky(creep + np.diag(1.0 / inverse))
        rows_white, seen_white = np.split(np.linalg.solve(lower, np.column_stack([rows, seen])), [-1], axis=1)
        normal += rows_white.T @ rows_white
        right += rows_white.T @ seen_white[:, 0]
        misfit += float(np.sum(seen_white**2))
        log_det += 2.0 * float(np.sum(np.log(np.diag(lower))))
    covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    found = covariance @ right
    evidence = -0.5 * (misfit - float(right @ found) + log_det + float(np.linalg.slogdet(normal)[1]))
    return found, covariance, evidence
