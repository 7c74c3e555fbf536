"""Centre of mass from equi-planes, with covariance (docs/explanation/method.md, section 4).

The equi-plane of a strike passes through its pivot line and the centre of mass.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analyze.errors import EstimationError
from analyze.estimation.equiplane import upright_in_gravity
from analyze.estimation.joint import JointSolution, solve_joint
from analyze.estimation.joint_model import COM
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.types import Array, CentreOfMass, EquiPlane, TableTilt

UNOBSERVED_FRACTION = 0.15
"""Fraction of the prior's sd above which a direction of c counts as not observed."""


def centre_of_mass(
    planes: Sequence[EquiPlane], systematic: SystematicErrors, prior: ComPrior
) -> CentreOfMass:
    """Centre of mass c (3,) [m] nearest all equi-planes, n_j.(c - p_j) = 0, from balance angles phi alone.

    The equi-plane of strike j passes through its pivot line and c; n_j is its unit normal, p_j a point on the
    line and R_j the distance of c from it. Unknowns beside c are the shared errors, with priors
    (joint_model.py): the lean of the vertical from the table's normal towards x and y of the world frame W,
    the shape's scale, the edges' radius, per axis the edge's place forward, its own radius and, per heading,
    an angle, and per resting face its place along its normal; every levelling of the table (set-up with one
    tilt) has its own lean. Repeats of one axis therefore average their own scatter only. The lean changes phi
    of a tip at heading h (direction on the table) by lean . (cos h, sin h): strikes over one edge at two
    headings, best 180 deg apart, separate the lean from all else (half the difference of their phi).
    Residuals are angles, about n_j.(c - p_j) / R_j at the measured phi_j; weights then follow R_j and no c is
    favoured for being near an edge.

    Args:
        planes: Equi-planes in the object frame O, one per strike.
        systematic: Standard deviations of errors that strikes share (table tilt, shape scale, edge radius).
        prior: Prior of c; determines the directions that strikes do not observe.

    Returns:
        c [m] in O with covariance, residual [m] and share of information per strike, and the table's tilts.

    Raises:
        EstimationError: there is no plane.
    """
    if not planes:
        raise EstimationError("no strike can be used: strike again, or exclude fewer strikes")
    return centre_of_mass_from_joint(solve_joint(planes, systematic, prior), prior)


def centre_of_mass_from_joint(solution: JointSolution, prior: ComPrior) -> CentreOfMass:
    """Centre of mass with covariance, residuals and shares of information, from a joint solution.

    Args:
        solution: Solution of the joint problem, by the strikes' balance angles phi alone or with their rate
            constants k too.
        prior: Prior of the centre of mass c that the problem was solved with.

    Returns:
        c in the object frame O; it counts as observed if the sd of its least certain direction is below
        `UNOBSERVED_FRACTION` of the prior's. The strikes' planes through pivot line and c are corrected for
        the estimated tilt.
    """
    model, x, covariance = solution.model, solution.x, solution.covariance
    position = x[COM]
    relative = covariance[COM, COM] / np.outer(prior.sd, prior.sd)
    values, vectors = np.linalg.eigh((relative + relative.T) / 2)
    observed = bool(np.sqrt(values[-1]) < UNOBSERVED_FRACTION)
    worst = vectors[:, -1] * prior.sd
    worst = worst / np.linalg.norm(worst)
    worst = worst * np.sign(worst[np.argmax(np.abs(worst))])
    distances = model.distances(x)
    arms = model.distance_design(x)
    upright = tuple(
        upright_in_gravity(plane, lean)
        for plane, lean in zip(model.planes, model.lean(x).tolist(), strict=True)
    )
    weights = solution.weight * _precision_of_phi(solution) / distances**2
    return CentreOfMass(
        position=position,
        covariance=covariance[COM, COM],
        observed=observed,
        unobserved_direction=None if observed else worst,
        residuals=np.array([plane.normal @ (position - plane.point) for plane in upright]),
        weights=weights / weights.sum(),
        distances=distances,
        distance_covariance=arms @ covariance @ arms.T,
        position_distance_covariance=covariance[COM] @ arms.T,
        robust=solution.weight,
        tilts=tuple(_tilt(solution, level) for level in range(len(model.tilts))),
        planes=upright,
    )


def _precision_of_phi(solution: JointSolution) -> Array:
    """Marginal precision (strikes,) [1/rad^2] of the balance angles, rate constants k integrated out."""
    inverse = solution.data.precisions
    used = solution.data.uses_k > 0
    # Schur complement, where a k is used.
    lost = np.where(used, inverse[:, 0, 1] ** 2 / np.where(used, inverse[:, 1, 1], 1.0), 0.0)
    return inverse[:, 0, 0] - lost


def _tilt(solution: JointSolution, level: int) -> TableTilt:
    """Estimated tilt of the table (2,) [rad], with covariance and prior sd, on levelling `level` from 0.

    The tilt is the lean of the vertical from the table's normal towards x and y of the world frame W; a
    levelling is a set-up of the table with one unknown tilt.
    """
    where, prior = solution.model.tilt_terms(level), solution.model.tilts[level]
    sd = np.array(prior.sd)
    return TableTilt(
        np.array(prior.lean) + sd * solution.x[where],
        solution.covariance[where, where] * np.outer(sd, sd),
        sd,
    )
