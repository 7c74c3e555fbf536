"""Ratios of a body's moments and products of inertia from free flights: no moment acts in flight.

The angular velocity w in the object frame O follows Euler's equations, J w' = -w x J w, with J the tensor
about the centre of mass. J enters up to a factor only. It is J = tr(S) 1 - S with S = L L^T the second
moments of the mass about its centre, so that every J is that of some body. Unknown besides J are, for every
flight, attitude and angular velocity at its start. The residuals follow a multivariate t distribution, every
flight with a scale of its own (Lange, Little and Taylor 1989), as in `free_flight`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.flight.attitude import rotated_attitudes, small_rotation, turned
from analyze.geometry.rotations import wxyz_from_matrix
from analyze.least_squares.grouped_errors import group_freedom, jackknife_covariance
from analyze.least_squares.intervals import student_sigmas_95
from analyze.types import TENSOR_ENTRIES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.flight.free_flight import Flight
    from analyze.motion.body_motion import BodyMotion
    from analyze.types import Array

MIN_THROWS = 8
"""least number of throws"""
_T_FREEDOM = 4.0
"""degrees of freedom of Student's t distribution of the residuals"""
_ROUNDS = 60
_STEP = 1e-5
"""step of the numerical derivatives [rad, rad/s, 1]"""
_LOCAL, _SHARED = 6, 5
"""unknowns of a flight (attitude, angular velocity) and of the body"""


@dataclass(frozen=True)
class FreeRotation:
    """Inertia tensor up to its factor, fitted to the rotation in free flights of one body.

    The tensor is that about the centre of mass, in the object frame O.
    """

    ratios: Array
    """(6,) its entries xx, yy, zz, xy, xz, yz over the mean of its diagonal"""
    covariance: Array
    """(6, 6) their covariance"""
    freedom: Array
    """(6,) degrees of freedom of their variances"""
    flights: int
    """number of flights"""
    residual: float
    """rms angle between measured and fitted attitude, about one axis [rad]; median over the flights"""

    @property
    def half_width(self) -> Array:
        """Half-widths (6,) of the 95 % intervals of xx, yy, zz, xy, xz, yz, by Student's t."""
        return student_sigmas_95(self.freedom) * np.sqrt(np.diag(self.covariance))


def tensor_ratios(inertia: Array) -> Array:
    """Entries (6,) xx, yy, zz, xy, xz, yz of an inertia tensor (3, 3) over the mean of its diagonal."""
    return np.array([inertia[place] for place in TENSOR_ENTRIES]) / (np.trace(inertia) / 3.0)


def fit_rotations(flights: Sequence[Flight]) -> FreeRotation:
    """Fit the inertia tensor, up to its factor, to the rotation in all flights of a body together.

    A throw may consist of several flights, between touches of the table; they may share errors.

    Args:
        flights: flights of one body, with the number of the throw.

    Returns:
        The ratios with their covariance, by the jackknife over the throws, and the flights' residual.

    Raises:
        EstimationError: fewer than `MIN_THROWS` (8) throws, or flights whose rotation does not determine the
            ratios, as where each turns about a principal axis.
    """
    groups = np.array([flight.group for flight in flights])
    names, member = np.unique(groups, return_inverse=True)
    if len(names) < MIN_THROWS:
        raise EstimationError(
            f"{len(names)} throws do not determine the inertia's ratios: {MIN_THROWS} are the least"
        )
    problem = _Problem([flight.motion for flight in flights])
    shape, weight = np.zeros(_SHARED), np.ones(len(flights))
    for _ in range(_ROUNDS):
        step, weight = _robust_step(*problem.reduced(shape), problem.counts, weight)
        size = float(np.max(np.abs(step)))
        shape = shape + step * min(1.0, 0.3 / max(size, 1e-12))
        if size < 1e-6:
            break
    normals, rights, squares = problem.reduced(shape)
    per_throw = [np.zeros((len(names), *each.shape[1:])) for each in (normals, rights)]
    np.add.at(per_throw[0], member, weight[:, None, None] * normals)
    np.add.at(per_throw[1], member, weight[:, None] * rights)
    whole, right = (each.sum(axis=0) for each in per_throw)
    without = np.array(
        [
            tensor_ratios(_inertia(shape + _solve(whole - normal, right - level)))
            for normal, level in zip(*per_throw, strict=True)
        ]
    )
    entries = tensor_ratios(_inertia(shape))
    steps = _STEP * np.eye(_SHARED)
    by_shape = (
        np.array([tensor_ratios(_inertia(shape + step)) for step in steps]).T - entries[:, None]
    ) / _STEP
    return FreeRotation(
        entries,
        jackknife_covariance(without),
        group_freedom(by_shape @ _inverse(whole), per_throw[0]),
        len(flights),
        float(np.sqrt(np.median(squares / problem.counts))),
    )


def _robust_step(
    normals: Array, rights: Array, squares: Array, counts: Array, weight: Array
) -> tuple[Array, Array]:
    """Step (5,) of the body's unknowns, and robust weights (f,) of the flights at its end.

    A flight whose residuals are large counts less.

    Args:
        normals: (f, 5, 5) normal matrices of the flights.
        rights: (f, 5) their right sides.
        squares: (f,) their sums of squares before the step.
        counts: (f,) their degrees of freedom.
        weight: (f,) weights to begin with.

    Raises:
        EstimationError: the flights do not determine the unknowns.
    """
    step = np.zeros(_SHARED)
    for _ in range(_ROUNDS):
        left = np.maximum(squares - 2 * rights @ step + normals @ step @ step, 1e-30)
        variance = float(weight @ left) / float(counts.sum())
        weight = (_T_FREEDOM + counts) / (_T_FREEDOM + left / variance)
        normal = np.einsum("f,frc->rc", weight, normals)
        size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        if np.linalg.cond(normal / np.outer(size, size)) > 1e8:
            raise EstimationError(
                f"{len(weight)} flights do not determine the inertia's ratios: throw so that the body tumbles"
            )
        before, step = step, _solve(normal, weight @ rights)
        if np.max(np.abs(step - before)) < 1e-8:
            break
    return step, weight


def _solve(matrix: Array, right: Array) -> Array:
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)


def _inverse(matrix: Array) -> Array:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def _inertia(shape: Array) -> Array:
    """Tensor (3, 3), up to its factor, from the five free entries of L with its first one 1."""
    lower = np.array(
        [[1.0, 0.0, 0.0], [shape[2], np.exp(shape[0]), 0.0], [shape[3], shape[4], np.exp(shape[1])]]
    )
    second = lower @ lower.T
    return np.trace(second) * np.eye(3) - second


class _Problem:
    """Attitudes of all flights, padded to the longest, and the start of each as fitted so far."""

    def __init__(self, motions: Sequence[BodyMotion]) -> None:
        frames = max(len(motion) for motion in motions)
        self.counts = np.array([3.0 * len(motion) - _LOCAL for motion in motions])
        self._time = np.array(
            [np.append(motion.time, [motion.time[-1]] * (frames - len(motion))) for motion in motions]
        )
        self._used = np.array([np.arange(frames) < len(motion) for motion in motions])
        measured = [wxyz_from_matrix(motion.R_world_object) for motion in motions]
        self._measured = np.array(
            [np.concatenate([each, np.repeat(each[-1:], frames - len(each), axis=0)]) for each in measured]
        )
        self._attitude = self._measured[:, 0].copy()
        self._spin = np.array([motion.angular_velocity[:3].mean(axis=0) for motion in motions])

    def reduced(self, shape: Array) -> tuple[Array, Array, Array]:
        """Normal equations of the body's unknowns, each flight's start fitted and eliminated.

        Args:
            shape: (5,) the body's unknowns.

        Returns:
            (f, 5, 5) normal matrices, (f, 5) right sides, and (f,) sums of squares [rad^2].
        """
        residual, jacobian = self._linearised(shape)
        local = jacobian[..., :_LOCAL]
        step = _solve(
            np.einsum("fri,frj->fij", local, local), -np.einsum("fri,fr->fi", local, residual)[..., None]
        )[..., 0]
        self._attitude = turned(self._attitude, step[:, :3])
        self._spin = self._spin + step[:, 3:]
        residual, jacobian = self._linearised(shape)
        local, shared = jacobian[..., :_LOCAL], jacobian[..., _LOCAL:]
        own = _inverse(np.einsum("fri,frj->fij", local, local))
        mixed = np.einsum("fri,frj->fij", local, shared)
        level = np.einsum("fri,fr->fi", local, residual)
        normals = np.einsum("fri,frj->fij", shared, shared) - np.einsum("fki,fkl,flj->fij", mixed, own, mixed)
        rights = np.einsum("fki,fkl,fl->fi", mixed, own, level) - np.einsum("fri,fr->fi", shared, residual)
        squares = np.einsum("fr,fr->f", residual, residual) - np.einsum("fi,fij,fj->f", level, own, level)
        return normals, rights, np.maximum(squares, 1e-30)

    def _linearised(self, shape: Array) -> tuple[Array, Array]:
        """Residuals (f, 3 n) [rad] and their derivatives (f, 3 n, 11) by start and body, numerically."""
        unknowns = _LOCAL + _SHARED
        flights = len(self.counts)
        attitude = np.repeat(self._attitude[None], unknowns + 1, axis=0)
        spin = np.repeat(self._spin[None], unknowns + 1, axis=0)
        inertia = np.repeat(_inertia(shape)[None], unknowns + 1, axis=0)
        for number in range(3):
            attitude[number + 1] = turned(self._attitude, _STEP * np.eye(3)[[number]].repeat(flights, 0))
            spin[number + 4, :, number] += _STEP
        for number in range(_SHARED):
            inertia[number + 7] = _inertia(shape + _STEP * np.eye(_SHARED)[number])
        path, _ = rotated_attitudes(attitude, spin, inertia, self._time)
        left = small_rotation(path, self._measured[None]) * self._used[None, :, :, None]
        left = left.reshape(unknowns + 1, flights, -1)
        return left[0], np.moveaxis((left[1:] - left[0]) / _STEP, 0, -1)
