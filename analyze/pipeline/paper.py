"""Centre of mass, and masses of shell and interior parts, by the paper's method.

The paper is VISAPP 2013, sections 3.2 and 3.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.estimation.cells import Cells
from analyze.estimation.paper import (
    PaperCentre,
    PaperRegions,
    paper_axis_inertia,
    paper_centre_of_mass,
    paper_regions,
)
from analyze.estimation.priors import Scale
from analyze.pipeline.equiplanes import equiplane_by
from analyze.pipeline.evidence import Evidence
from analyze.types import Array, EquiPlane, MotionFit, TipMotion
from schemas.strike_result import Verdict

SIGN_CHANGE = "sign_change"
"""name of the paper's estimator: the sign change of the angular acceleration"""
MIN_TIPS = 3
"""least number of strikes that tipped over the balance with which those that rocked back do not count"""


@dataclass(frozen=True)
class PaperEstimate:
    """Centre of mass, and masses of shell and interior parts, by the paper's method (VISAPP 2013).

    The shell is the outer wall. There are no masses (None) if for no pivot axis three positive masses have
    the object's mass as their sum.
    """

    com: PaperCentre
    """centre of mass; with markers as `paper_estimate` returns it, in `Estimate.paper` without them where the
    pose of each marker with a mass is known"""
    regions: PaperRegions | None
    """masses of shell and interior parts; None if for no pivot axis three positive masses have the object's
    mass as their sum"""


def paper_estimate(
    evidence: Evidence, used: Sequence[TipMotion], cells: Cells, scale: Scale
) -> tuple[PaperEstimate, tuple[EquiPlane, ...]]:
    """The paper's centre of mass and region masses, markers included, with the equi-planes used.

    An equi-plane, one per strike, passes through its pivot line and the centre of mass. If at least
    `MIN_TIPS` strikes tipped over the balance, only those are used; otherwise also strikes that rocked back.
    The paper is VISAPP 2013; regions are the shell and the interior on either side of a plane.

    Args:
        evidence: fitted strikes, of which the plan is used.
        used: motions of the strikes of the joint estimate.
        cells: the body divided into cells, in shell and interior.
        scale: mass and gravity.

    Returns:
        The estimate in the object frame O, and one equi-plane (through pivot line and centre of mass) per
        strike used, at the balance angle by the paper's estimator, or by the fit chosen for the motion if the
        paper's estimator has none.
    """
    # The sign change exists only where c passes over the balance; strikes that rocked back are used only if
    # too few others exist.
    tipped_over = [motion for motion in used if motion.verdict is Verdict.GOOD]
    chosen = tipped_over if len(tipped_over) >= MIN_TIPS else list(used)
    planes = tuple(equiplane_by(evidence.planned(motion), motion, SIGN_CHANGE) for motion in chosen)
    com = paper_centre_of_mass(planes, cells)
    return PaperEstimate(com, _paper_regions(planes, chosen, com.position, scale, cells)), planes


def _sign_change(motion: TipMotion) -> MotionFit | None:
    """Fit by the paper's estimator (balance angle at the second sign change of acceleration), or None."""
    return next((fit for fit in motion.alternatives if fit.estimator == SIGN_CHANGE), None)


def _paper_regions(
    planes: Sequence[EquiPlane], motions: Sequence[TipMotion], com: Array, scale: Scale, cells: Cells
) -> PaperRegions | None:
    """Masses [kg] of shell, upper and lower part by the method of VISAPP 2013; None if no masses fit.

    Given too are the plane that divides the interior, in the object frame O, and the moments of inertia about
    the edges [kg m^2] as the method corrects them. The measured moment about each edge is the mean over its
    strikes. A strike's balance angle is that by the paper's estimator, or that of the fit chosen for the
    motion if the paper's estimator has none.

    Args:
        planes: planes of the strikes through pivot line and centre of mass, in the object frame O.
        motions: motion of each plane's strike.
        com: (3,) the paper's centre of mass [m], in O.
        scale: mass and gravity.
        cells: the body divided into cells.
    """
    moments: dict[str, list[float]] = {}
    for plane, motion in zip(planes, motions, strict=True):
        fit = _sign_change(motion) or motion.fit
        found = (
            None if fit is None else paper_axis_inertia(plane, motion, fit, com, scale.mass * scale.gravity)
        )
        if found is not None:
            moments.setdefault(plane.axis_id, []).append(found.i_edge)
    one_per_axis = {plane.axis_id: plane for plane in planes}
    about_edges = {axis_id: float(np.mean(each)) for axis_id, each in moments.items()}
    return paper_regions(list(one_per_axis.values()), com, about_edges, scale.mass, cells)
