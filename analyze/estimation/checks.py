"""Checks of a joint solution: leave-one-out predictions, gravity, moments, centre of mass."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.joint import TWO_ERRORS_AS_ONE, JointSolution, MomentModel, solve_joint
from analyze.estimation.joint_model import COM, GRAVITY, SECOND
from analyze.estimation.moment_prior import widened
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.estimation.refit import Refit, refit_without
from analyze.estimation.strike_data import whitened
from analyze.types import Array, EquiPlane

OPEN_GRAVITY_RELATIVE_SD = 0.2
"""Relative 1 sigma of g where g is estimated."""
FILLING_FACTOR = 3.0
"""Factor on the shape's prior sd of the moments in checks: with the prior as it is, a lump inside a box
passes for a gravity 2 to 6 % too strong."""
AXIS_K_FLOOR = 3e-3
"""Relative 1 sigma of an axis's k beside the stated errors where g is estimated. Struck edges hop by 0.2 to
0.4 mm in contact simulations; there k of a box scatters by 0.41 %, 2.3 times its stated sd."""
SIGMAS = 3.0
"""Standardised error above which a check fails."""
MAX_PREDICTED_PHI_SD = math.radians(1.5)
"""1 sigma [rad] of a predicted balance angle above which the prediction checks nothing."""


@dataclass(frozen=True)
class LeaveOneOut:
    """Prediction of a strike's phi and k from all other strikes, compared with the measured values.

    phi is the balance angle, k = m g R / I_edge the rate constant of the tipping motion, with m the mass, g
    gravity, R the distance of the centre of mass from the edge and I_edge the moment of inertia about it.
    """

    strike_id: str
    """Id of the strike."""
    phi: float
    """Predicted phi [rad], from the pose in which the object rested."""
    phi_off: float
    """Measured minus predicted phi [rad]."""
    phi_sd: float
    """1 sigma of `phi_off` [rad]: prediction and measurement together."""
    k_off: float | None
    """Measured minus predicted ln k; None if k is not used."""
    k_sd: float | None
    """1 sigma of `k_off`; None if k is not used."""
    sigmas: float
    """Differences of phi and k together, as one standardised error."""
    k: float
    """Predicted k [rad/s^2], for gravity at the place of the first recording."""
    by_others: Array
    """(2, 2) covariance of the predicted (phi, ln k), phi in rad."""
    own: Array
    """(2, 2) covariance of the strike's own (phi, ln k), phi in rad; 0 for a k that is not used."""
    checkable: bool = True
    """False if the other strikes leave phi open, or predict it only by a model that is far from linear."""

    @property
    def agrees(self) -> bool:
        """True if the strike agrees with its prediction by all other strikes, within `SIGMAS` sd.

        Its balance angle phi and the rate constant k of its motion theta'' = -k sin(phi - theta) are judged
        together; phi alone if k is not used.
        """
        return self.sigmas <= SIGMAS


@dataclass(frozen=True)
class GravityEstimate:
    """Gravity g estimated from the strikes, as a relative difference from the stated g.

    The strikes separate g from the moments of inertia if axes have different distances from the centre of
    mass.
    """

    relative: float
    """Estimated over stated g, minus 1."""
    sd: float
    """1 sigma of `relative`."""
    single_axis: str | None = None
    """Id of the pivot axis without whose k gravity agrees; None if it agrees, or no single axis explains the
    difference."""

    @property
    def agrees(self) -> bool:
        """True if gravity estimated from the strikes differs from the stated one by at most `SIGMAS` sd."""
        return abs(self.relative) <= SIGMAS * self.sd


def leave_one_out(solution: JointSolution) -> tuple[LeaveOneOut, ...]:
    """Predict each strike's phi and ln k from all other strikes, and compare them with the measured ones.

    phi is the balance angle [rad], k the rate constant of the tipping motion [rad/s^2]. No
    estimate is made again: each strike in turn is taken out linearly about the solution of all. phi and k
    carry all the information that the tipping angle theta(t) has about the body; the prediction of theta(t)
    itself is in motion/predicted_motion.py.

    Args:
        solution: Solution of the joint problem of all strikes.

    Returns:
        One comparison per strike, in the order of `solution.model.planes`, which holds one plane per strike:
        predicted phi and k, measured minus predicted phi and ln k with their 1 sigma, both differences as one
        standardised error, and the covariances (2, 2) of (phi, ln k) of prediction and measurement.
    """
    model, x, weight = solution.model, solution.x, solution.weight
    information = np.linalg.inv(solution.covariance)
    phi, by_phi = model.residual(x), model.design(x)
    log_k, by_k = model.log_k(x)
    found: list[LeaveOneOut] = []
    for i, plane in enumerate(model.planes):
        uses_k = bool(solution.data.uses_k[i])
        parts, as_one_error = (2, TWO_ERRORS_AS_ONE) if uses_k else (1, 1.0)
        precision = solution.data.precisions[i, :parts, :parts] / solution.spread
        both = np.stack([by_phi[i], by_k[i]])
        rows = both[:parts]
        off: Array = np.array([phi[i], log_k[i] - solution.data.log_k[i]])[:parts]
        others = np.asarray(
            np.linalg.inv(information - weight[i] * rows.T @ precision @ rows), dtype=np.float64
        )
        moved = both @ others @ rows.T @ precision @ off * weight[i]
        off = off + moved[:parts]
        own = np.zeros((2, 2))
        own[:parts, :parts] = np.linalg.inv(precision)
        by_others = np.asarray(both @ others @ both.T, dtype=np.float64)
        expected = (by_others + own)[:parts, :parts]
        sigmas = as_one_error * math.sqrt(float(off @ np.linalg.solve(expected, off)))
        sd = np.sqrt(np.diag(expected))
        found.append(
            LeaveOneOut(
                strike_id=plane.strike_id,
                phi=plane.phi - plane.rest_turn + float(off[0]),
                phi_off=-float(off[0]),
                phi_sd=float(sd[0]),
                k_off=-float(off[1]) if uses_k else None,
                k_sd=float(sd[1]) if uses_k else None,
                sigmas=sigmas,
                k=math.exp(float(log_k[i] + moved[1])),
                by_others=by_others,
                own=own,
            )
        )
    return tuple(found)


def checked_left_out(
    solution: JointSolution, prior: ComPrior, moments: MomentModel
) -> tuple[LeaveOneOut, ...]:
    """Predictions of each strike from all others, made again without linearisation where one fails.

    A strike that fails the prediction by the model linearised about the solution is judged again by a
    likelihood ratio (refit.py), with the sd of the shape's prior of the moments `FILLING_FACTOR` times
    larger, as a lump inside the object needs. If it fails that too, the prediction returned is that of the
    problem solved without it; if it passes there, its prediction is marked as not checkable. So is that of a
    strike that passes at once, if the others leave its balance angle phi open (sd above
    `MAX_PREDICTED_PHI_SD`).

    Args:
        solution: Joint solution of all strikes.
        prior: Prior of the centre of mass, as in the solution.
        moments: Mass, gravity, and the shape's prior of the moments, as in the solution.

    Returns:
        One prediction of phi [rad] and of the rate constant k [rad/s^2] per strike, compared with the
        measured values, in the order of `solution.model.planes`.
    """
    wide = replace(moments, prior=widened(moments.prior, FILLING_FACTOR))
    found: list[LeaveOneOut] = []
    for i, linear in enumerate(leave_one_out(solution)):
        if not linear.agrees:
            found.append(_judged_again(solution, linear, i, refit_without(solution, prior, wide, i)))
        else:
            phi_is_open = math.sqrt(float(linear.by_others[0, 0])) > MAX_PREDICTED_PHI_SD
            found.append(replace(linear, checkable=not phi_is_open))
    return tuple(found)


def _judged_again(solution: JointSolution, linear: LeaveOneOut, index: int, refit: Refit) -> LeaveOneOut:
    """Judge a strike that failed its linear prediction again, by the problem solved without it.

    Args:
        solution: Joint solution of all strikes.
        linear: Prediction by the model linearised about the solution, which the strike fails.
        index: Number of the strike.
        refit: Solution without the strike, and the rise of the misfit that the strike causes.

    Returns:
        Prediction by `refit` if the strike fails again; else `linear` with the standardised error by the
        likelihood ratio, marked as not checkable.
    """
    uses_k = linear.k_off is not None
    sigmas = math.sqrt(refit.rise) * (TWO_ERRORS_AS_ONE if uses_k else 1.0)
    if sigmas <= SIGMAS:
        return replace(linear, sigmas=sigmas, checkable=False)
    model, x = solution.model, refit.x
    log_k, by_log_k = model.log_k(x)
    both = np.stack([model.design(x)[index], by_log_k[index]])
    by_others = np.asarray(both @ refit.covariance @ both.T, dtype=np.float64)
    sd = np.sqrt(np.diag(by_others + linear.own))
    off = float(model.residual(x)[index])
    return replace(
        linear,
        phi=model.planes[index].phi - model.planes[index].rest_turn + off,
        phi_off=-off,
        phi_sd=float(sd[0]),
        k_off=float(solution.data.log_k[index] - log_k[index]) if uses_k else None,
        k_sd=float(sd[1]) if uses_k else None,
        sigmas=sigmas,
        k=math.exp(float(log_k[index])),
        by_others=by_others,
    )


def estimated_gravity(
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: MomentModel,
    initial: JointSolution,
) -> GravityEstimate:
    """Gravity estimated from phi and k of all strikes, as a relative difference from the stated one.

    All strikes are estimated again with `OPEN_GRAVITY_RELATIVE_SD` as gravity's relative sd, a wider prior
    of the moments (`FILLING_FACTOR`) and a larger error of each axis's k (`AXIS_K_FLOOR`). If gravity
    differs by more than `SIGMAS` sd, it is solved once more without the k of each axis. An axis is named as
    the cause if the others agree with the stated gravity, and by themselves exclude the difference found; of
    several such axes it is the one without which all strikes fit best. None is named if gravity differs by
    more than `OPEN_GRAVITY_RELATIVE_SD`.

    Args:
        planes: Equi-planes of the strikes (plane through pivot line and centre of mass), in the object
            frame O, with their balance angles phi and rate constants k.
        systematic: Standard deviations of errors that strikes share (table tilt, shape scale, edge radius).
        prior: Prior of the centre of mass.
        moments: Mass, stated gravity, and the prior of the inertia by the shape.
        initial: Solution with the stated gravity, to start from.

    Returns:
        Ratio of estimated to stated gravity, less 1, with its sd: 0 if they are equal.
    """
    wide = widened(moments.prior, FILLING_FACTOR)
    scale = replace(
        moments.scale,
        gravity_sd=OPEN_GRAVITY_RELATIVE_SD * moments.scale.gravity,
        k_relative_sd=float(np.hypot(moments.scale.k_relative_sd, AXIS_K_FLOOR)),
    )

    def solved(used: Sequence[EquiPlane]) -> tuple[GravityEstimate, float]:
        solution = solve_joint(used, systematic, prior, MomentModel(scale, wide), initial)
        return _open_gravity(solution), _shared_misfit(solution)

    found, _ = solved(planes)
    if found.agrees or abs(found.relative) > OPEN_GRAVITY_RELATIVE_SD:
        return found
    cause, least = None, np.inf
    for axis in sorted({plane.axis_id for plane in planes if plane.k is not None}):
        rest, misfit = solved(
            [replace(plane, k=None) if plane.axis_id == axis else plane for plane in planes]
        )
        alone = rest.agrees and abs(found.relative - rest.relative) > SIGMAS * rest.sd
        if alone and misfit < least:
            cause, least = axis, misfit
    return replace(found, single_axis=cause)


def _shared_misfit(solution: JointSolution) -> float:
    """Sum of squares of all standardised residuals of the strikes, and of the errors that they share.

    Each shared error (such as the table's tilt) is counted in units of its own standard deviation.
    """
    z, _ = whitened(solution.model, solution.data, solution.x)
    return float(np.sum(z**2) + np.sum(solution.x[SECOND.stop :] ** 2))


def _open_gravity(found: JointSolution) -> GravityEstimate:
    """Ratio of estimated to stated gravity, less 1, with its sd, from a solution that estimates gravity.

    The problem must have been solved with `OPEN_GRAVITY_RELATIVE_SD` as gravity's relative sd.
    """
    relative = float(np.expm1(OPEN_GRAVITY_RELATIVE_SD * found.x[GRAVITY]))
    sd = OPEN_GRAVITY_RELATIVE_SD * float(np.sqrt(found.covariance[GRAVITY, GRAVITY]))
    return GravityEstimate(relative, sd)


def sigmas_outside_hull(com: Array, covariance: Array, hull_planes: Array) -> float:
    """Distance of the centre of mass outside the shape's hull in standard deviations; 0 if it lies inside.

    Outside each plane of the hull the distance is divided by the sd along the plane's normal; the largest of
    these ratios is returned.

    Args:
        com: (3,) centre of mass [m], in the object frame O.
        covariance: (3, 3) covariance of `com` [m^2].
        hull_planes: (p, 4) outward unit normal n and offset d [m] of the hull's p planes n.x + d = 0.
    """
    height = hull_planes[:, :3] @ com + hull_planes[:, 3]
    sd = np.sqrt(np.einsum("pi,ij,pj->p", hull_planes[:, :3], covariance, hull_planes[:, :3]))
    return max(0.0, float(np.max(height / np.maximum(sd, 1e-12))))


def impossible_moments(solution: JointSolution, hull_vertices: Array) -> list[str]:
    """Ids of the pivot axes whose measured moment of inertia no mass within the shape's hull can have.

    The strikes give the moment per kilogram about the line l through the centre of mass c, parallel to the
    axis: I_c,l / m = g R / k - (R + rho)^2. Here m is the mass, g gravity, R the distance of c from the
    centre line of the edge's rounding, rho the radius of the edge, k the rate constant fitted to the strike's
    motion. No mass has a negative moment, or one above (b1 - c1)(c1 - a1) + (b2 - c2)(c2 - a2), where 1 and 2
    are two coordinates perpendicular to the axis, along which the hull extends from a to b (Bhatia and Davis
    2000). An axis is listed if the moment of one of its strikes is below zero, or above that bound, by more
    than `SIGMAS` standard deviations.

    Args:
        solution: Joint solution with k; strikes whose k is not used are skipped.
        hull_vertices: (h, 3) vertices of the shape's hull [m], in the object frame O.

    Returns:
        Sorted ids; empty if all moments are possible.
    """
    model, x, P = solution.model, solution.x, solution.covariance
    about_com, by = model.about_com(x)
    ln_k, by_ln_k = model.log_k(x)
    edge = model.about_edge(x)[0]
    found: set[str] = set()
    for i, plane in enumerate(model.planes):
        if not solution.data.uses_k[i]:
            continue
        ends = (hull_vertices - x[COM]) @ np.stack([plane.up, np.cross(plane.direction, plane.up)], axis=1)
        most = float(np.sum(np.maximum(ends.max(axis=0), 0) * np.maximum(-ends.min(axis=0), 0)))
        # The moment that this strike's k alone implies, with all else as estimated.
        own = float(about_com[i] - edge[i] * (solution.data.log_k[i] - ln_k[i]))
        own_sd = edge[i] * np.sqrt(
            by_ln_k[i] @ P @ by_ln_k[i] + (plane.sd_k or 0.0) ** 2 / (plane.k or 1.0) ** 2
        )
        sd = float(np.hypot(own_sd, np.sqrt(by[i] @ P @ by[i])))
        if own + SIGMAS * sd < 0 or own - SIGMAS * sd > most:
            found.add(plane.axis_id)
    return sorted(found)


@dataclass(frozen=True)
class Checks:
    """Results of all checks of one joint solution (the estimate from all strikes).

    They are: predictions of each strike from the others, gravity by the strikes, axes with an impossible
    moment of inertia, and the distance of the centre of mass outside the hull.
    """

    left_out: tuple[LeaveOneOut, ...]
    """Leave-one-out predictions, one per strike."""
    gravity: GravityEstimate
    """Gravity estimated from the strikes alone, relative to the stated one."""
    impossible_axes: tuple[str, ...]
    """Ids of axes with an impossible moment of inertia."""
    sigmas_outside_hull: float
    """Distance of the centre of mass outside the hull in standard deviations; 0 if it lies inside."""


def check_solution(
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: MomentModel,
    solution: JointSolution,
    hull: tuple[Array, Array],
) -> Checks:
    """Check a joint solution: each strike predicted from the others, gravity, moments, centre of mass.

    Args:
        planes: Equi-planes of the strikes (plane through pivot line and centre of mass), in the object
            frame O.
        systematic: Standard deviations of errors that strikes share (table tilt, shape scale, edge radius).
        prior: Prior of the centre of mass.
        moments: Mass, gravity, and the shape's prior of the moments.
        solution: Joint solution of these planes, which was found with the same `systematic`, `prior` and
            `moments`.
        hull: Vertices (h, 3) [m] and planes (p, 4) (outward n.x + d = 0) of the shape's hull, in O.

    Returns:
        Results of all checks: one prediction per strike, gravity relative to the stated one, ids of the axes
        with an impossible moment of inertia, and the distance of the centre of mass outside the hull, in
        standard deviations (0 inside). Nothing is raised where one fails.
    """
    return Checks(
        checked_left_out(solution, prior, moments),
        estimated_gravity(planes, systematic, prior, moments, solution),
        tuple(impossible_moments(solution, hull[0])),
        sigmas_outside_hull(solution.x[COM], solution.covariance[COM, COM], hull[1]),
    )
