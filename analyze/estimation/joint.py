"""Joint estimate of centre of mass c, second moments and shared errors (method.md, section 7).

The data are the balance angle phi and the rate constant k = m g R / I_edge [rad/s^2] of every strike (m mass,
g gravity, R the distance of c from the edge, I_edge the moment of inertia about the edge). With their
covariance they contain all that a free tip says about the body: angle and speed at which a tip began say
nothing about it, and the fit of the motion has integrated them out. Second moments are the integrals of x x^T
over the mass, per kilogram, about c (second_moments.py); they determine the inertia tensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.joint_model import COM, LENGTHS, SECOND, JointModel
from analyze.estimation.moment_prior import MomentPrior, UnitPrior, shape_rows
from analyze.estimation.priors import ComPrior, Scale, SystematicErrors
from analyze.estimation.scatter import ErrorFactors, estimated_factors
from analyze.estimation.strike_data import StrikeData, strike_data, whitened
from analyze.types import Array, EquiPlane

MAX_REESTIMATES = 4
"""Largest number of times that the sd of scatter and of tilt are estimated."""
MAX_ITERATIONS = 60
"""Largest number of Gauss-Newton steps."""
CONVERGED_STEP = 1e-11
"""Largest change of an unknown in the last step: [m] for c, units of their sd for shared errors."""
ROUNDED_DECREASE = 1e-12
"""Decrease of the misfit by a step, over the misfit, below which the step is taken as it is."""
OUTLIER_SIGMAS = 2.5
"""Standardised error above which a strike's robust weight falls below 1."""
TWO_ERRORS_AS_ONE = 2.5 / 2.97
"""Factor from the norm of two standardised errors to the equally likely one of a single error, at
`OUTLIER_SIGMAS`."""
LOG_LENGTH_SD = 2.0
"""Prior 1 sigma of the logarithms of the body's lengths (diagonal of U, where U U^T are the second moments),
beside the shape's prior of the moments."""
MAX_LOG_STEP = 1.0
"""Largest change of the logarithm of one of the body's lengths in one step."""
GYRATION_OVER_COM_SD = 0.5
"""Radius of gyration over c's largest prior sd, where no moments are estimated."""


@dataclass(frozen=True)
class MomentModel:
    """Mass, gravity and prior of the inertia: the inputs needed to use the strikes' rate constants k.

    k = m g R / I_edge [rad/s^2], with m the mass, g gravity, R the distance of the centre of mass from the
    edge and I_edge the moment of inertia about the edge.
    """

    scale: Scale
    """Mass and gravity."""
    prior: MomentPrior
    """Prior of the inertia per kilogram."""


@dataclass(frozen=True)
class JointSolution:
    """Estimate of centre of mass, second moments and shared errors from all strikes, with covariance.

    It is the maximum of their posterior, with outliers given less weight. Second moments are those of the
    mass about its centre, per kilogram (second_moments.py); they determine the inertia. Shared errors are
    those common to several strikes: table tilt, shape scale, gravity, places of edges and faces. The data and
    the model of the estimate are included.
    """

    model: JointModel
    """Model of the strikes' balance angles and rate constants k as functions of the unknowns."""
    x: Array
    """(count,) unknowns, in the order of `JointModel`; count is their number."""
    covariance: Array
    """(count, count) covariance of the unknowns."""
    weight: Array
    """(strikes,) robust weights: 1 for errors within the stated sd, towards 0 for an outlier."""
    spread: float
    """Observed over expected variance of the strikes' scatter, at least 1 (Birge ratio squared)."""
    data: StrikeData
    """Measured ln k and whitening matrices."""
    moment_prior: UnitPrior | None
    """Prior of the moments at the estimated c; None if k is not used."""
    stated: SystematicErrors
    """Errors as stated before any strike; those of `model` have the sd of scatter and tilt by the strikes."""
    factors: ErrorFactors
    """Factors on the stated sd of scatter and tilt, by the strikes."""


def solve_joint(
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: MomentModel | None = None,
    initial: JointSolution | None = None,
) -> JointSolution:
    """Estimate centre of mass c, second moments and shared errors jointly from phi and k of all strikes.

    Gauss-Newton with the exact Jacobian and robust weights, at most `MAX_ITERATIONS` steps. A strike far off
    all others loses weight (Huber 1964, with redescending weights). The sd of the scatter of phi from strike
    to strike, and that of the table's tilt, are then estimated from the strikes (scatter.py) and the problem
    is solved again. If phi and k still scatter more than their standard deviations allow, the variances of
    the strikes' own errors are multiplied by the ratio of observed to expected scatter (Birge 1932).

    Args:
        planes: Equi-planes (plane through pivot line and c) in the object frame O with their balance angles
            phi and rate constants k, one per strike, at least one.
        systematic: Stated standard deviations of errors that strikes share (table tilt, shape scale, edge
            radius) and of the scatter from strike to strike.
        prior: Prior of c.
        moments: Inputs for k, to estimate the second moments too; None to use phi alone.
        initial: Solution of a problem with the same unknowns, to start from; ignored if their number differs.

    Returns:
        Unknowns (c, second moments, shared errors) at the maximum of the posterior, with covariance and the
        strikes' robust weights.
    """
    factors = ErrorFactors()
    found = _solve(planes, systematic, prior, moments, None if initial is None else (initial.x, None))
    for _ in range(MAX_REESTIMATES if planes else 0):
        before, factors = factors, _factors(found, systematic, factors, prior, moments)
        if factors.similar(before):
            break
        found = _solve(planes, factors.applied(systematic), prior, moments, (found.x, found.weight))
    return replace(found, stated=systematic, factors=factors)


def _factors(
    found: JointSolution,
    stated: SystematicErrors,
    present: ErrorFactors,
    prior: ComPrior,
    moments: MomentModel | None,
) -> ErrorFactors:
    """Factors on the stated sd of scatter and tilt, from the solution with the `present` ones.

    Args:
        found: Solution of the problem with the present factors.
        stated: Shared errors as stated before any strike.
        present: Factors used for the solution.
        prior: Prior of the centre of mass.
        moments: Inputs for k; None if only the balance angles phi are used.
    """
    start, diagonal = prior_start(found.model, prior, moments)
    off = diagonal * (found.x - start)
    if found.moment_prior is not None:
        apart, by = shape_rows(found.moment_prior, found.x)
        off = off + by.T @ apart
    covariance = np.asarray(
        np.linalg.inv(prior_information(diagonal, found.moment_prior, found.x)), dtype=np.float64
    )
    before_strikes = found.x - covariance @ off, covariance
    return estimated_factors(
        found.model, stated, present, found.weight, found.x, before_strikes, moments is not None
    )


def _solve(
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: MomentModel | None,
    initial: tuple[Array, Array | None] | None,
) -> JointSolution:
    """Joint estimate from all strikes, with the sds of shared errors and scatter that `systematic` has.

    Args:
        planes: Equi-planes of the strikes.
        systematic: Standard deviations of errors that strikes share, and of their scatter.
        prior: Prior of the centre of mass.
        moments: Inputs for k; None to use the balance angles phi alone.
        initial: Unknowns (count,) to start from, ignored if their number differs, and robust weights
            (strikes,) if known; None to start from the priors.
    """
    model = JointModel(planes, systematic, None if moments is None else moments.scale)
    data = strike_data(planes, systematic.strike_angle_sd, moments is not None)
    shape = None if moments is None else moments.prior(prior.mean)
    start, diagonal = prior_start(model, prior, moments)
    x, weight = (start, None) if initial is None else initial
    if len(x) != model.count:
        x = start
    if weight is None:
        weight = _initial_weights(
            planes, np.hypot([plane.sd_phi for plane in planes], systematic.strike_angle_sd)
        )
    z, rows = whitened(model, data, x)
    precision = prior_information(diagonal, shape, x)
    for _ in range(MAX_ITERATIONS):
        before = x
        shape = None if moments is None else moments.prior(x[COM])
        x, z, rows = _step(model, data, (start, diagonal, shape), x, weight, z, rows)
        precision = prior_information(diagonal, shape, x)
        freedom = float(data.parts.sum()) - _effective_parameters(precision, rows, weight)
        each = np.abs(np.concatenate([z[:, 0], z[data.uses_k > 0, 1]]))
        usual = float(np.median(each)) if len(each) else 0.0
        scatter = max(1.0, 1.4826 * usual * np.sqrt(len(each) / max(freedom, 1.0)))
        # A strike's errors of phi and ln k as one.
        error = np.sqrt(np.sum(z**2, axis=1)) * np.where(data.uses_k > 0, TWO_ERRORS_AS_ONE, 1.0)
        weight = np.minimum(1.0, (OUTLIER_SIGMAS * scatter / np.maximum(error, 1e-9)) ** 2)
        if float(np.abs(x - before).max()) < CONVERGED_STEP:
            break
    freedom = float(weight @ data.parts) - _effective_parameters(precision, rows, weight)
    spread = max(1.0, float(weight @ np.sum(z**2, axis=1)) / freedom) if freedom >= 1.0 else 1.0
    information = strikes_information(rows, weight / spread)
    covariance = np.asarray(np.linalg.inv(precision + information), dtype=np.float64)
    return JointSolution(model, x, covariance, weight, spread, data, shape, systematic, ErrorFactors())


def prior_start(model: JointModel, prior: ComPrior, moments: MomentModel | None) -> tuple[Array, Array]:
    """Prior mean (count,) and inverse variances (count,) of the unknowns of the problem of all strikes.

    Their order and units are those of `JointModel`: centre of mass [m], six numbers for the second moments,
    errors that strikes share [sd]. The shape's prior of the inertia tensor is not part of them
    (`shape_rows`).

    Args:
        model: Model of the strikes, which gives number and order of the unknowns.
        prior: Prior of the centre of mass.
        moments: Gravity, and the shape's prior of the inertia; None if only the balance angles phi are used,
            not the rate constants k.
    """
    inertia = np.eye(3) * (GYRATION_OVER_COM_SD * float(prior.sd.max())) ** 2
    if moments is not None:
        inertia = moments.prior(prior.mean).mean
    diagonal = np.ones(model.count)
    diagonal[COM] = prior.sd**-2
    # Wide enough to matter only for impossibly flat bodies: logarithms of lengths, and U's other entries in
    # units of size.
    diagonal[SECOND] = LOG_LENGTH_SD**-2 * np.array([1.0, 1.0, 1.0, *[1 / float(np.trace(inertia))] * 3])
    return model.start(prior.mean, inertia), diagonal


def strikes_information(rows: Array, weight: Array) -> Array:
    """Information (count, count) that the strikes contribute about the `count` unknowns.

    It is an inverse covariance.

    Args:
        rows: (strikes, 2, count) derivatives by the unknowns of the residuals (modelled minus measured) of
            the balance angle and of ln k (rate constant), scaled to independent errors of unit sd.
        weight: (strikes,) robust weights.
    """
    flat = rows.reshape(-1, rows.shape[-1])
    return flat.T @ (flat * np.repeat(weight, 2)[:, None])


def prior_information(diagonal: Array, shape: UnitPrior | None, x: Array) -> Array:
    """Information (count, count) that the priors contribute about the unknowns, an inverse covariance.

    The unknowns are those of `JointModel`: centre of mass, second moments, then errors that strikes share
    (table tilt, shape scale, edge radius, gravity, places of edges and faces). The prior that the shape gives
    of the inertia is not linear in them and is linearised at `x`.

    Args:
        diagonal: (count,) inverse variances of the unknowns' own priors.
        shape: The shape's prior of the moments; None if no moments are estimated.
        x: (count,) unknowns.
    """
    precision = np.diag(diagonal)
    if shape is not None:
        rows = shape_rows(shape, x)[1]
        precision = precision + rows.T @ rows
    return precision


def _step(
    model: JointModel,
    data: StrikeData,
    prior: tuple[Array, Array, UnitPrior | None],
    x: Array,
    weight: Array,
    z: Array,
    rows: Array,
) -> tuple[Array, Array, Array]:
    """Unknowns (count,) after one Gauss-Newton step, shortened until the misfit does not rise.

    The unknowns are those of `JointModel`: centre of mass, second moments (the first three of them logarithms
    of the body's lengths), shared errors. The misfit is the weighted sum of squared `z` plus the squared
    deviations from the priors, in sd. The step is limited in those logarithms, then halved as often as
    needed.

    Args:
        model: Model of balance angle phi and ln k (rate constant) of the strikes.
        data: Measured ln k and the matrices that whiten (phi, ln k).
        prior: Prior mean (count,) and inverse variances (count,) of the unknowns, and the shape's prior of
            the inertia; None for no such prior.
        x: (count,) unknowns before the step.
        weight: (strikes,) robust weights.
        z: (strikes, 2) standardised residuals of (phi, ln k) at `x`.
        rows: (strikes, 2, count) derivatives of `z` by the unknowns.

    Returns:
        The unknowns after the step, and `z` and `rows` at them. If none of twelve step sizes lowers the
        misfit or keeps it, `x`, `z` and `rows` as given.
    """
    start, diagonal, shape = prior

    def misfit(x: Array, z: Array) -> float:
        off = 0.0 if shape is None else float(np.sum(shape_rows(shape, x)[0] ** 2))
        return float(weight @ np.sum(z**2, axis=1) + diagonal @ (x - start) ** 2) + off

    flat = rows.reshape(-1, model.count)
    gradient = flat.T @ (np.repeat(weight, 2) * z.ravel()) + diagonal * (x - start)
    normal = np.diag(diagonal) + strikes_information(rows, weight)
    if shape is not None:
        off, by = shape_rows(shape, x)
        gradient, normal = gradient + by.T @ off, normal + by.T @ by
    step = -np.linalg.solve(normal, gradient)
    step = step * min(1.0, MAX_LOG_STEP / max(float(np.abs(step[LENGTHS]).max()), 1e-12))
    before = misfit(x, z)
    # Below it the misfit's rounding hides whether a step lowers it.
    rounding = -float(gradient @ step) < ROUNDED_DECREASE * before
    for _ in range(12):
        there = whitened(model, data, x + step)
        if rounding or misfit(x + step, there[0]) <= before:
            return x + step, *there
        step = step / 2
    return x, z, rows


def _effective_parameters(precision: Array, rows: Array, weight: Array) -> float:
    """Effective number of parameters that the strikes, not the priors, determine: trace of the hat matrix.

    Args:
        precision: (count, count) information (inverse covariance) of the priors about the `count` unknowns.
        rows: (strikes, 2, count) derivatives by the unknowns of the residuals (modelled minus measured) of
            the balance angle and of ln k (rate constant), scaled to independent errors of unit sd.
        weight: (strikes,) robust weights.
    """
    information = strikes_information(rows, weight)
    return float(np.trace(np.linalg.solve(precision + information, information)))


def _initial_weights(planes: Sequence[EquiPlane], sd: Array) -> Array:
    """Initial robust weights (strikes,), below 1 for a strike whose phi is far from that of its repeats.

    phi is the balance angle, `sd` (strikes,) its standard deviation [rad]. Strikes are repeats of each other
    if they share the axis, the heading (direction of the tip on the table) and the levelling (set-up of the
    table). With three or more, the weight follows from the distance to their median phi; with fewer it is 1.
    """
    weight = np.ones(len(planes))
    for i, plane in enumerate(planes):
        alike = (plane.axis_id, plane.heading, plane.level)
        same = [other.phi for other in planes if (other.axis_id, other.heading, other.level) == alike]
        if len(same) >= 3:
            middle = float(np.median(same))
            spread = max(float(sd[i]), 1.4826 * float(np.median(np.abs(np.array(same) - middle))))
            weight[i] = min(1.0, (OUTLIER_SIGMAS * spread / max(abs(plane.phi - middle), 1e-12)) ** 2)
    return weight
