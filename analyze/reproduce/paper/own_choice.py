"""Centre of mass from the paper's own choice of three strikes (3.1.3), given angles without error."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import PlanError
from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.equiplane import equiplane_from_fit
from analyze.estimation.paper import paper_centre_of_mass
from analyze.estimation.priors import ComPrior
from analyze.pipeline.equiplanes import systematic_errors
from analyze.planning.design import MIN_NORMAL_SPREAD
from analyze.planning.examine import Bench
from analyze.planning.impact import StrikerModel
from analyze.planning.information import normal_spread, unknown_direction
from analyze.planning.paper_strikes import paper_strike_plan
from analyze.planning.prepared import FRICTION, prepare_object
from analyze.planning.view import default_camera
from analyze.reproduce.paper.record import OwnChoice
from analyze.result.score import tip_truth
from analyze.types import EquiPlane, MotionFit

if TYPE_CHECKING:
    from analyze.pipeline.estimate import Estimate
    from schemas.proto import percuss_pb2 as pb
    from schemas.strike_plan import PlannedStrike

STRIKES = 9
"""Number of strikes planned by the paper's rule."""
ANGLE_SD = math.radians(0.05)
"""1 sigma [rad] stated to our estimator for the exact angles."""


def com_from_papers_choice(estimate: Estimate, body: pb.TruthBody) -> OwnChoice:
    """Errors of the centre of mass by the paper's method and by ours, from the paper's choice of strikes.

    The paper is VISAPP 2013. Both methods get the true balance angles, one strike per pivot axis.

    Args:
        estimate: result of the session, for its shape, stated errors and cells (pieces of the body).
        body: ground truth, from which the angles are computed.

    Returns:
        Distances [m] of both centres of mass from the true one, with our stated sd [m], number of axes,
        spread of the planes' normals and friction needed; or only the reason why the paper's planner has no
        strikes.
    """
    evidence = estimate.evidence
    prepared = prepare_object(
        evidence.model, evidence.spec, Bench(StrikerModel(), default_camera(), FRICTION)
    )
    try:
        plan = paper_strike_plan(prepared, evidence.object_sha256, STRIKES)
    except PlanError as error:
        return OwnChoice(refused=str(error).partition(": ")[2])
    planes = [
        _exact_plane(strike, body) for strike in {strike.axis_id: strike for strike in plan.strikes}.values()
    ]
    true = np.array(body.com_object)
    prior = ComPrior.from_bounds(*evidence.model.bounds)
    ours = centre_of_mass(planes, systematic_errors(evidence), prior)
    paper = paper_centre_of_mass(planes, estimate.cells)
    normals = np.array([plane.normal for plane in planes])
    return OwnChoice(
        axes=len(planes),
        spread=normal_spread(normals),
        open_direction=unknown_direction(normals).tolist()
        if normal_spread(normals) < MIN_NORMAL_SPREAD
        else None,
        friction_needed=max(strike.aim.friction_needed for strike in plan.strikes),
        paper_off_m=float(np.linalg.norm(paper.position - true)),
        ours_off_m=float(np.linalg.norm(ours.position - true)),
        ours_sd_m=float(np.sqrt(np.trace(ours.covariance))),
        ours_observed=ours.observed,
    )


def _exact_plane(strike: PlannedStrike, body: pb.TruthBody) -> EquiPlane:
    covariance = np.diag([ANGLE_SD**2, 0.0])
    fit = MotionFit("", tip_truth(strike, body).phi, None, covariance, 0.0, 0.0, 0, (0, 0), np.zeros(0))
    return equiplane_from_fit(strike.id, strike, fit)
