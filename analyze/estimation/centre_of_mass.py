"""Centre of mass from equi-planes: what the joint estimate says of it, with phi alone or with k (METHOD: "ours")."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analyze.errors import EstimationError
from analyze.estimation.equiplane import plumb
from analyze.estimation.joint import JointSolution, solve_joint
from analyze.estimation.joint_model import COM
from analyze.estimation.stated import ComPrior, SystematicErrors
from analyze.types import Array, CentreOfMass, EquiPlane, TableTilt

UNOBSERVED_FRACTION = 0.15
"""a direction whose sd is above this part of the prior's was not measured"""


def centre_of_mass(planes: Sequence[EquiPlane], systematic: SystematicErrors, prior: ComPrior) -> CentreOfMass:
    """The point nearest all equi-planes, n_j.(c - p_j) = 0, and how well it is known; by phi alone.

    Beside c the shared errors are unknowns with priors (joint_model.py): the lean of the vertical towards W's x and y, the shape's scale,
    the edges' radius, and per axis the edge's place (two directions across itself), its own radius and, per heading, an angle; every
    levelling of the table has its own lean. So repeats of one axis average their own scatter only. A tip at heading h feels
    lean . (cos h, sin h): strikes of one edge at two headings, best 180 deg apart, tell the lean from everything else (half the difference
    of their phi). Residuals are angles, n_j.(c - p_j) / R_j at the measured phi_j, so that weights follow R_j and no c is favoured for
    being near an edge.

    Args:
        planes: one per strike, in O.
        systematic: shared errors.
        prior: used where strikes do not tell.

    Raises:
        EstimationError: no plane.
    """
    refuse_none(planes)
    return com_of(solve_joint(planes, systematic, prior), prior)


def refuse_none(planes: Sequence[EquiPlane]) -> None:
    """Say what is missing.

    Raises:
        EstimationError: no plane.
    """
    if not planes:
        raise EstimationError("no good strike: strike again, or lower the number of excluded strikes")


def com_of(solution: JointSolution, prior: ComPrior) -> CentreOfMass:
    """C, and what comes with it."""
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
    upright = tuple(plumb(plane, lean) for plane, lean in zip(model.planes, model.lean(x).tolist(), strict=True))
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
    """(strikes,) 1/rad^2, whatever k says beside it."""
    W = solution.data.whiten
    inverse = np.swapaxes(W, 1, 2) @ W
    used = solution.data.uses_k > 0
    # The marginal precision: the Schur complement, where there is a k.
    lost = np.where(used, inverse[:, 0, 1] ** 2 / np.where(used, inverse[:, 1, 1], 1.0), 0.0)
    return inverse[:, 0, 0] - lost


def _tilt(solution: JointSolution, level: int) -> TableTilt:
    where, prior = solution.model.tilt_terms(level), solution.model.tilts[level]
    sd = np.array(prior.sd)
    return TableTilt(np.array(prior.lean) + sd * solution.x[where], solution.covariance[where, where] * np.outer(sd, sd), sd)
