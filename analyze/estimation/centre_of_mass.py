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
from analyze.estimation.mass_properties import CentreOfMass, TableTilt
from analyze.estimation.posterior import Posterior, linear_posterior
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.types import Array, EquiPlane

UNOBSERVED_FRACTION = 0.15
"""Fraction of the prior's sd above which a direction of c counts as not observed."""
OPEN_FRACTION = 0.05
"""Fraction of the prior's sd above which a direction of c counts as not observed where moments are not linear
in c along it: the box that bounds the object, rather than strikes, then limits c."""


def centre_of_mass(
    planes: Sequence[EquiPlane], systematic: SystematicErrors, prior: ComPrior
) -> CentreOfMass:
    """Centre of mass c (3,) [m] nearest all equi-planes, n_j.(c - p_j) = 0, from balance angles phi alone.

    The equi-plane of strike j passes through its pivot line, and c by its phi; n_j is its unit normal, p_j a
    point on the line and R_j the distance of c from the line. The residual of a strike is an angle, about
    n_j.(c - p_j) / R_j at the measured phi_j, so that no c is favoured for lying near an edge.

    Errors that strikes share are unknowns beside c, each with a prior (joint_model.py):

    - for all strikes: the shape's scale and the edges' radius;
    - for each levelling (set-up of the table with one tilt): the lean of the vertical from the table's normal
      towards x and y of the world frame W;
    - for each pivot axis: the place of its edge in the direction of the tip, the edge's own radius, and for
      each heading (direction of the tip on the table) an error of the measured angle;
    - for each face rested on, or rising from a pivot edge: its place along its normal;
    - for each face rested on: the part of the radius that its edges share;
    - the turns of the object at rest, and that of all markers on it, where the data depend on them.

    Repeats about one axis therefore average only their own scatter. The lean changes phi of a tip at heading
    h by lean . (cos h, sin h). Strikes over one edge at two headings, best 180 deg apart, separate the lean
    from all other errors: it makes half the difference of their phi.

    Args:
        planes: Equi-planes in the object frame O, one per strike.
        systematic: Standard deviations of errors that strikes share (table tilt, shape scale, edge radius).
        prior: Prior of c; determines the directions that strikes do not observe.

    Returns:
        c [m] in O with covariance; per strike the distance of c from its plane [m] and its share of the
        information; the tilt of each levelling.

    Raises:
        EstimationError: there is no plane.
    """
    if not planes:
        raise EstimationError("no strike can be used: strike again, or exclude fewer strikes")
    return centre_of_mass_from_joint(solve_joint(planes, systematic, prior), prior)


def centre_of_mass_from_joint(
    solution: JointSolution, prior: ComPrior, posterior: Posterior | None = None
) -> CentreOfMass:
    """Centre of mass c with its covariance, taken from the solution of the joint problem of all strikes.

    Args:
        solution: Solution of the joint problem, by the strikes' balance angles phi alone or with their rate
            constants k [rad/s^2] too.
        prior: Prior of c that the problem was solved with.
        posterior: Distribution of c where it is not normal (profile.py); None to propagate errors linearly.

    Returns:
        c [m] in the object frame O with covariance; it counts as observed if the sd of its least certain
        direction is below `UNOBSERVED_FRACTION` of the prior's (`OPEN_FRACTION` if `posterior` is a mixture).
        Per strike: the plane through the pivot line in which this strike's own phi places c, corrected for
        the estimated tilt of the table; the signed distance [m] of the estimated c from this plane
        (residual); the distance [m] of c from the pivot line; its share of the information about c; its
        robust weight. Also the estimated tilts.
    """
    model, x, posterior = solution.model, solution.x, posterior or linear_posterior(solution)
    position, covariance, R = posterior.mean[COM], posterior.covariance, posterior.distances
    relative = covariance[COM, COM] / np.outer(prior.sd, prior.sd)
    values, vectors = np.linalg.eigh((relative + relative.T) / 2)
    limit = UNOBSERVED_FRACTION if posterior.linear else OPEN_FRACTION
    observed = bool(np.sqrt(values[-1]) < limit)
    worst = vectors[:, -1] * prior.sd
    worst = worst / np.linalg.norm(worst)
    worst = worst * np.sign(worst[np.argmax(np.abs(worst))])
    distances = posterior.mean[R]
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
        distance_covariance=covariance[R, R],
        position_distance_covariance=covariance[COM, R],
        robust=solution.weight,
        tilts=tuple(_tilt(solution, level) for level in range(len(model.tilts))),
        planes=upright,
        intervals=None if posterior.linear else np.array([posterior.interval(i) for i in range(3)]),
    )


def _precision_of_phi(solution: JointSolution) -> Array:
    """Precision (1 over variance) [1/rad^2] of each strike's balance angle phi alone, (strikes,).

    Where the rate constant k of the motion was measured together with phi, the precision is the marginal
    one: k is integrated out.
    """
    inverse = solution.data.precisions
    used = solution.data.uses_k > 0
    # Schur complement, where a k is used.
    lost = np.where(used, inverse[:, 0, 1] ** 2 / np.where(used, inverse[:, 1, 1], 1.0), 0.0)
    return inverse[:, 0, 0] - lost


def _tilt(solution: JointSolution, level: int) -> TableTilt:
    """Estimated tilt of the table (2,) [rad] in levelling number `level`, with covariance and prior sd.

    The tilt is the lean of the vertical from the table's normal towards x and y of the world frame W, its
    covariance (2, 2) [rad^2], its stated sd (2,) [rad]. A levelling is a set-up of the table with one unknown
    tilt; levellings count from 0.
    """
    where, prior = solution.model.tilt_terms(level), solution.model.tilts[level]
    sd, stated_sd = np.array(prior.sd), np.array(solution.stated.tilts()[level].sd)
    return TableTilt(
        np.array(prior.lean) + sd * solution.x[where],
        solution.covariance[where, where] * np.outer(sd, sd),
        stated_sd,
    )
