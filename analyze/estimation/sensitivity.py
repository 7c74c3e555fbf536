"""Sensitivity of the centre of mass to each strike, and its uncertainty by source of error."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analyze.estimation.joint import JointSolution
from analyze.estimation.joint_model import (
    ANGLE,
    AXIS_TERMS,
    COM,
    FIRST_AXIS_TERM,
    FORWARD,
    GRAVITY,
    LEVEL_TERMS,
    OWN_K,
    OWN_RADIUS,
    RADIUS,
    SCALE_TERM,
    SECOND,
    TILT,
    JointModel,
)
from analyze.estimation.mass_properties import InertialParameters
from analyze.estimation.priors import ComPrior
from analyze.types import Array

NEGLIGIBLE_SHARE = 1e-9
"""Share of c's variance below which an error source is omitted."""


class ErrorSource(enum.Enum):
    """Sources of error of the centre of mass; the value is the source's name in words.

    In these names, k is the rate constant fitted to a strike's motion.
    """

    NOISE = "noise of the frames"
    SCATTER = "scatter from strike to strike"
    TILT = "tilt of the table"
    SCALE = "scale of the shape"
    ROUNDING = "rounding of the edges"
    PLACE = "place of edges and faces"
    ANGLE = "angle error of an axis"
    K = "gravity, air and play, in k"
    PRIOR = "shape, where strikes determine nothing"
    MASS = "mass of object and markers"
    FIXTURE = "fixture, and place of the object in it"


@dataclass(frozen=True)
class Influence:
    """Derivatives of the centre of mass c by one strike's balance angle phi and by its ln k.

    Each is a vector (3,): c [m] is in the object frame O, phi in rad, and k [rad/s^2] the rate constant of
    the strike's motion, theta'' = -k sin(phi - theta) with theta the tipping angle. All strikes keep the
    weights that the robust estimate of c gave them.
    """

    strike_id: str
    """Id of the strike."""
    axis_id: str
    """Id of its pivot axis."""
    by_phi: Array
    """(3,) dc/dphi [m/rad], in the object frame O."""
    by_log_k: Array
    """(3,) dc/dln k [m], in O: change of c per relative change of k."""


@dataclass(frozen=True)
class SourceShare:
    """Contribution of one error source to the covariance (3, 3) [m^2] of the centre of mass c, in O.

    O is the object frame.
    """

    source: ErrorSource
    """The source of error."""
    covariance: Array
    """(3, 3) covariance [m^2], in the object frame O; the sum over all sources is the covariance of c."""


@dataclass(frozen=True)
class Sensitivity:
    """Influence of every strike on the centre of mass c, and share of each error source in its covariance.

    The influence of a strike is the derivative (3,) of c by its balance angle [m/rad] and by its ln k [m],
    with k = m g R / I_edge the rate constant of its motion (R the distance of c from the edge, I_edge the
    moment of inertia about it). The share is a covariance (3, 3) [m^2].
    """

    strikes: tuple[Influence, ...]
    """Influences in the order of the joint estimate's planes."""
    shares: tuple[SourceShare, ...]
    """Contributions in the order of `ErrorSource`, without negligible ones."""


def sensitivity(
    solution: JointSolution,
    prior: ComPrior,
    whole: InertialParameters,
    bare: InertialParameters,
    remainder: ErrorSource = ErrorSource.MASS,
) -> Sensitivity:
    """Influence of each strike on the centre of mass c, and of each error source on its covariance.

    Both are linear about the solution. Let P be the covariance of all unknowns. A unit change of a
    measurement, with derivative B by the unknowns and inverse covariance W, moves the unknowns by P B^T W. An
    error that strikes share is itself an unknown, in units of its sd: 1 sd of it moves the unknowns by its
    column of P. The contribution of a source to the covariance of c is that of its errors, propagated so.

    Args:
        solution: Joint solution of all strikes.
        prior: Prior of c, used for the solution.
        whole: Parameters of the body that tipped, from the solution.
        bare: Parameters reported: `whole`, or those without markers (printed tags) or fixture; c then moves
            by more, as the body weighs less.
        remainder: Source of what subtracting adds: the masses, or the fixture.

    Returns:
        Influences, one per strike, in the order of `solution.model.planes`, and the contributions that are
        not negligible.
    """
    factor = whole.mass / bare.mass
    parts = {source: factor**2 * covariance for source, covariance in _shares(solution, prior)}
    parts[remainder] = bare.com.covariance - factor**2 * whole.com.covariance
    total = float(np.trace(bare.com.covariance))
    return Sensitivity(
        tuple(_influences(solution, factor)),
        tuple(
            SourceShare(source, parts[source])
            for source in ErrorSource
            if source in parts and float(np.trace(parts[source])) > NEGLIGIBLE_SHARE * total
        ),
    )


def _rows(solution: JointSolution) -> Array:
    """Derivatives (strikes, 2, count) of balance angle phi [rad] and ln k by the joint fit's unknowns.

    k [rad/s^2] is the rate constant of the tipping motion; the derivatives of ln k are 0 for a strike whose k
    is not used. The unknowns, count in number, are those of `JointModel`: centre of mass, second moments,
    shared errors.
    """
    model, x = solution.model, solution.x
    return np.stack([model.design(x), model.log_k(x)[1] * solution.data.uses_k[:, None]], axis=1)


def _influences(solution: JointSolution, factor: float) -> Iterator[Influence]:
    """Yield per strike the derivatives (3,) of the centre of mass by its phi [m/rad] and by its ln k [m].

    phi is the strike's balance angle, k the rate constant of its motion; vectors are in the object frame O.
    Strikes are in the order of `solution.model.planes`.

    Args:
        solution: joint solution of all strikes.
        factor: mass with markers over the mass without them, if they are subtracted, else 1; it multiplies
            the derivatives.
    """
    rows, precisions, weight = _rows(solution), solution.data.precisions, solution.weight
    information = np.einsum("sic,sij,sjd,s->cd", rows, precisions, rows, weight)
    # The covariance includes the spread factor; the estimate itself does not depend on it.
    normal = np.linalg.inv(solution.covariance) + information * (1 - 1 / solution.spread)
    for i, plane in enumerate(solution.model.planes):
        moved: Array = np.asarray(
            factor * weight[i] * np.linalg.solve(normal, rows[i].T @ precisions[i])[COM], dtype=np.float64
        )
        yield Influence(plane.strike_id, plane.axis_id, moved[:, 0], moved[:, 1])


def _shares(solution: JointSolution, prior: ComPrior) -> Iterator[tuple[ErrorSource, Array]]:
    """Yield pairs: a source of error, and its part (3, 3) [m^2] of the covariance of the centre of mass.

    First noise of the frames and scatter from strike to strike, then the errors that strikes share (table
    tilt, scale, edges and others), last the prior of the shape; not the mass.
    """
    P, rows, precisions = solution.covariance, _rows(solution), solution.data.precisions
    scatter, noise = np.zeros((3, 3)), np.zeros((3, 3))
    stated = np.diag([solution.model.systematic.strike_angle_sd**2, 0.0])
    for i in range(len(rows)):
        parts = 2 if solution.data.uses_k[i] else 1
        precision = precisions[i, :parts, :parts] * solution.weight[i] / solution.spread
        gain: Array = np.asarray((P @ rows[i, :parts].T @ precision)[COM], dtype=np.float64)
        share: Array = gain @ stated[:parts, :parts] @ gain.T * solution.spread / solution.weight[i]
        own = np.asarray(np.linalg.inv(precision), dtype=np.float64)
        scatter, noise = scatter + share, noise + gain @ own @ gain.T - share
    yield ErrorSource.NOISE, noise
    yield ErrorSource.SCATTER, scatter
    for source, terms in _terms(solution.model).items():
        gain = P[COM][:, terms]
        yield source, gain @ gain.T
    information = np.einsum("sic,sij,sjd,s->cd", rows, precisions, rows, solution.weight) / solution.spread
    second = (np.linalg.inv(P) - information)[SECOND, SECOND]
    yield (
        ErrorSource.PRIOR,
        P[COM, COM] @ np.diag(prior.sd**-2) @ P[COM, COM] + P[COM, SECOND] @ second @ P[SECOND, COM],
    )


def _terms(model: JointModel) -> dict[ErrorSource, list[int]]:
    """Indices of each error source's unknowns in the vector of all unknowns of `JointModel`, by source.

    Sources without unknowns of their own (noise, scatter of the angles, prior, mass) are absent.
    """
    axes = [FIRST_AXIS_TERM + AXIS_TERMS * number for number in range(model.axes)]
    faces = FIRST_AXIS_TERM + AXIS_TERMS * model.axes
    rounding, levels = faces + model.faces, faces + 2 * model.faces
    headings = levels + LEVEL_TERMS * (len(model.tilts) - 1)
    return {
        ErrorSource.TILT: [*range(TILT.start, TILT.stop), *range(levels, headings)],
        ErrorSource.SCALE: [SCALE_TERM],
        ErrorSource.ROUNDING: [RADIUS, *(first + OWN_RADIUS for first in axes), *range(rounding, levels)],
        ErrorSource.PLACE: [*(first + FORWARD for first in axes), *range(faces, rounding)],
        ErrorSource.ANGLE: [*(first + ANGLE for first in axes), *range(headings, model.count)],
        ErrorSource.K: [GRAVITY, *(first + OWN_K for first in axes)],
    }
