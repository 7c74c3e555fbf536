"""The joint estimate (METHOD section 7): c, second moments and all shared errors from phi and k of every strike, as one problem.

phi and k with their covariance say all that a free tip says of the body: its start is integrated out by the fit of that one motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from analyze.estimation.joint_model import COM, LENGTHS, SECOND, JointModel
from analyze.estimation.second_moments import six, unit_inertia
from analyze.estimation.stated import ComPrior, Scale, SystematicErrors
from analyze.types import Array, EquiPlane

ITERATIONS = 60
CONVERGED = 1e-11
"""m, and sd of shared errors"""
TURNING_POINT = 2.5
"""standard deviations from which a strike is taken for an outlier and loses weight"""
OF_TWO = 2.5 / 2.97
"""what two standardised errors together are as one, at that point: chi^2 of two is passed there as often as that of one"""
WIDE = 2.0
"""1 sigma of the logarithm of the body's lengths (of its second moments), beside what the shape says of its moments"""
LONGEST_STEP = 1.0
"""of such a logarithm"""
ASSUMED_GYRATION = 0.5
"""of the prior sd of c: where nothing is said of the moments"""


@dataclass(frozen=True)
class UnitPrior:
    """What the shape says of the inertia about c per kilogram."""

    mean: Array
    """(3, 3) m^2"""
    sd: Array
    """(3, 3) m^2, 1 sigma of each entry"""


MomentPrior = Callable[[Array], UnitPrior]
"""of c (3,)"""


@dataclass(frozen=True)
class Moments:
    """What it takes to use k."""

    scale: Scale
    prior: MomentPrior


@dataclass(frozen=True)
class Data:
    """phi and, where it is used, ln k of the strikes, whitened strike by strike."""

    log_k: Array
    """(strikes,)"""
    uses_k: Array
    """(strikes,) 1 or 0"""
    whiten: Array
    """(strikes, 2, 2): its square is the inverse covariance of (phi, ln k)"""

    @property
    def parts(self) -> Array:
        """(strikes,) how many numbers each strike gives."""
        return 1.0 + self.uses_k


@dataclass(frozen=True)
class JointSolution:
    """Where all strikes and priors agree best."""

    model: JointModel
    x: Array
    """(count,) as in JointModel"""
    covariance: Array
    """(count, count)"""
    weight: Array
    """(strikes,) 1 = as good as its sd says, towards 0 = an outlier"""
    spread: float
    """variance of the strikes' own scatter over the stated one"""
    data: Data
    moment_prior: UnitPrior | None
    """as of the c found"""


def solve_joint(
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: Moments | None = None,
    near: JointSolution | None = None,
) -> JointSolution:
    """Gauss-Newton with the exact Jacobian; a strike far off all others loses weight (Huber 1964, with redescending weights).

    If the strikes scatter more than they should, all random parts are widened (Birge 1932).

    Args:
        planes: one per strike, at least one.
        systematic: shared errors.
        prior: of c.
        moments: to use k and estimate the second moments; None: phi alone.
        near: another solution of a problem with the same unknowns, to start from.
    """
    model = JointModel(planes, systematic, None if moments is None else moments.scale)
    data = _data(planes, systematic, moments is not None)
    shape = None if moments is None else moments.prior(prior.mean)
    inertia = np.eye(3) * (ASSUMED_GYRATION * float(prior.sd.max())) ** 2 if shape is None else shape.mean
    start = model.start(prior.mean, inertia)
    diagonal = np.ones(model.count)
    diagonal[COM] = prior.sd**-2
    # So wide that only a body as flat as no body is feels it: the logarithms of its lengths, and U's other entries in its size.
    diagonal[SECOND] = WIDE**-2 * np.array([1.0, 1.0, 1.0, *[1 / float(np.trace(inertia))] * 3])
    x = start if near is None or len(near.x) != model.count else near.x
    weight = _weights_among_repeats(planes, np.hypot([plane.sd_phi for plane in planes], systematic.strike_angle_sd))
    z, rows = _whitened(model, data, x)
    precision = _precision(diagonal, shape, x)
    for _ in range(ITERATIONS):
        before = x
        shape = None if moments is None else moments.prior(x[COM])
        x = _step(model, data, (start, diagonal, shape), x, weight, z, rows)
        z, rows = _whitened(model, data, x)
        precision = _precision(diagonal, shape, x)
        freedom = float(data.parts.sum()) - _effective(precision, rows, weight)
        each = np.abs(np.concatenate([z[:, 0], z[data.uses_k > 0, 1]]))
        scatter = max(1.0, 1.4826 * float(np.median(each)) * np.sqrt(len(each) / max(freedom, 1.0)))
        weight = np.minimum(1.0, (TURNING_POINT * scatter / np.maximum(_distance(z, data), 1e-9)) ** 2)
        if float(np.abs(x - before).max()) < CONVERGED:
            break
    freedom = float(weight @ data.parts) - _effective(precision, rows, weight)
    spread = max(1.0, float(weight @ np.sum(z**2, axis=1)) / freedom) if freedom >= 1.0 else 1.0
    covariance = np.asarray(np.linalg.inv(precision + _information(rows, weight / spread)), dtype=np.float64)
    return JointSolution(model, x, covariance, weight, spread, data, shape)


def _data(planes: Sequence[EquiPlane], systematic: SystematicErrors, with_k: bool) -> Data:
    n = len(planes)
    covariance = np.tile(np.eye(2), (n, 1, 1))
    log_k, uses_k = np.zeros(n), np.zeros(n)
    for i, plane in enumerate(planes):
        covariance[i, 0, 0] = plane.sd_phi**2 + systematic.strike_angle_sd**2
        if with_k and plane.k is not None and plane.sd_k:
            log_k[i], uses_k[i] = np.log(plane.k), 1.0
            covariance[i, 1, 1] = (plane.sd_k / plane.k) ** 2
            covariance[i, 0, 1] = covariance[i, 1, 0] = plane.cov_phi_k / plane.k
    # Upper triangular: the phi's row comes first and is its error given k's.
    whiten = np.swapaxes(np.asarray(np.linalg.cholesky(np.linalg.inv(covariance)), dtype=np.float64), 1, 2)
    whiten[uses_k == 0, 1] = 0.0
    return Data(log_k, uses_k, whiten)


def _whitened(model: JointModel, data: Data, x: Array) -> tuple[Array, Array]:
    """Standardised residuals (strikes, 2) and their derivatives (strikes, 2, count)."""
    log_k, by_log_k = model.log_k(x)
    both = np.stack([model.residual(x), (log_k - data.log_k) * data.uses_k], axis=1)
    rows = np.stack([model.design(x), by_log_k * data.uses_k[:, None]], axis=1)
    return np.einsum("sij,sj->si", data.whiten, both), np.einsum("sij,sjc->sic", data.whiten, rows)


def _standardised(model: JointModel, data: Data, x: Array) -> Array:
    """The residuals (strikes, 2) alone."""
    both = np.stack([model.residual(x), (model.log_k(x)[0] - data.log_k) * data.uses_k], axis=1)
    return np.einsum("sij,sj->si", data.whiten, both)


def _distance(z: Array, data: Data) -> Array:
    """How far off (strikes,) each is, as a standardised error."""
    return np.sqrt(np.sum(z**2, axis=1)) * np.where(data.uses_k > 0, OF_TWO, 1.0)


def _information(rows: Array, weight: Array) -> Array:
    flat = rows.reshape(-1, rows.shape[-1])
    return flat.T @ (flat * np.repeat(weight, 2)[:, None])


def _shape_rows(shape: UnitPrior, x: Array) -> tuple[Array, Array]:
    """Standardised misfit (6,) of the second moments to what the shape says, and its derivative (6, count)."""
    J, by = unit_inertia(x[SECOND])
    sd = six(shape.sd)
    rows = np.zeros((6, len(x)))
    rows[:, SECOND] = six(by).T / sd[:, None]
    return six(J - shape.mean) / sd, rows


def _precision(diagonal: Array, shape: UnitPrior | None, x: Array) -> Array:
    precision = np.diag(diagonal)
    if shape is not None:
        rows = _shape_rows(shape, x)[1]
        precision = precision + rows.T @ rows
    return precision


def _step(
    model: JointModel, data: Data, prior: tuple[Array, Array, UnitPrior | None], x: Array, weight: Array, z: Array, rows: Array
) -> Array:
    """One Gauss-Newton step (Levenberg's cure: halved until the misfit falls); `z`, `rows` are those of `x`."""
    start, diagonal, shape = prior

    def misfit(x: Array, z: Array) -> float:
        off = 0.0 if shape is None else float(np.sum(_shape_rows(shape, x)[0] ** 2))
        return float(weight @ np.sum(z**2, axis=1) + diagonal @ (x - start) ** 2) + off

    flat = rows.reshape(-1, model.count)
    gradient = flat.T @ (np.repeat(weight, 2) * z.ravel()) + diagonal * (x - start)
    normal = np.diag(diagonal) + _information(rows, weight)
    if shape is not None:
        off, by = _shape_rows(shape, x)
        gradient, normal = gradient + by.T @ off, normal + by.T @ by
    step = -np.linalg.solve(normal, gradient)
    step = step * min(1.0, LONGEST_STEP / max(float(np.abs(step[LENGTHS]).max()), 1e-12))
    before = misfit(x, z)
    for _ in range(12):
        if misfit(x + step, _standardised(model, data, x + step)) <= before:
            return x + step
        step = step / 2
    return x


def _effective(precision: Array, rows: Array, weight: Array) -> float:
    """Number of parameters that the data determine: trace of the hat matrix."""
    information = _information(rows, weight)
    return float(np.trace(np.linalg.solve(precision + information, information)))


def _weights_among_repeats(planes: Sequence[EquiPlane], sd: Array) -> Array:
    """First weights (strikes,): distance from the median phi of the same axis, heading and levelling, where there are at least three."""
    weight = np.ones(len(planes))
    for i, plane in enumerate(planes):
        alike = (plane.axis_id, plane.heading, plane.level)
        same = [other.phi for other in planes if (other.axis_id, other.heading, other.level) == alike]
        if len(same) >= 3:
            middle = float(np.median(same))
            spread = max(float(sd[i]), 1.4826 * float(np.median(np.abs(np.array(same) - middle))))
            weight[i] = min(1.0, (TURNING_POINT * spread / max(abs(plane.phi - middle), 1e-12)) ** 2)
    return weight
