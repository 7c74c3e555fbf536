"""The paper's own method (sections 3.2 and 3.3) on a session's strikes, with our edges and theta(t).

theta is the tipping angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from analyze.errors import EstimationError
from analyze.estimation.equiplane import equiplane_from_fit
from analyze.estimation.paper import PaperRegions, paper_axis_inertia, paper_centre_of_mass, paper_regions
from analyze.types import Array, EquiPlane, MotionFit, TipMotion
from schemas.strike_result import Verdict

if TYPE_CHECKING:
    from analyze.pipeline.estimate import Estimate
    from schemas.strike_plan import PlannedStrike


@dataclass(frozen=True)
class PaperAnswer:
    """Result of the paper's method from one round: one strike on each axis (pivot edge).

    It holds the centre of mass [m] in the object frame O, the moment of inertia about each edge [kg m^2], and
    the masses of shell, upper and lower part [kg].
    """

    com: Array
    """Centre of mass (3,) [m] in O."""
    i_edge: dict[str, float]
    """Moment of inertia about each edge [kg m^2] by axis id (VISAPP 2013, eq. 5)."""
    left_out: dict[str, float]
    """Fraction of stage two's frames that eq. (5) leaves out, by axis id."""
    regions: PaperRegions | None
    """Masses of shell, upper and lower part; None without a solution.

    There is none if no moment about an edge is known, or if no dividing plane gives three positive masses
    with the right sum, with any moment within 5 % of the measured one.
    """


@dataclass(frozen=True)
class _Struck:
    planned: PlannedStrike
    motion: TipMotion
    fit: MotionFit


def paper_answers(estimate: Estimate) -> list[PaperAnswer]:
    """Results of the paper's method (VISAPP 2013), one per round of strikes, as in the paper's tables.

    Round i consists of the i-th strike on each axis (pivot edge). Only strikes with verdict "good" count:
    they tipped over without sliding, twisting or rolling on. The axis with the fewest such strikes, of those
    that have any, sets the number of rounds; the list is empty without such strikes. The balance angle of a
    strike is the tipping angle at the second sign change of the angular acceleration. The moments of inertia
    about the edges follow from eq. 5, with the distance of the edge from the paper's own centre of mass. The
    region masses are computed with this centre of mass as well.

    Returns:
        Per round: centre of mass [m] in the object frame O, moments of inertia about the edges [kg m^2], and
        the masses of shell, upper and lower part, None where there is no solution.
    """
    by_axis = _by_axis(estimate)
    rounds = min((len(each) for each in by_axis.values()), default=0)
    return [_answer([each[i] for each in by_axis.values()], estimate) for i in range(rounds)]


def sign_change_fit(motion: TipMotion) -> MotionFit | None:
    """The fit of a strike by the paper's estimator, among those in its `motion`; None if it has none.

    The paper takes the tipping angle theta at the second sign change of the angular acceleration (the first
    is the end of the strike) as balance angle phi. None also if the strike's verdict is not "good", for
    example if the object rocked back or slid.
    """
    good = motion.verdict is Verdict.GOOD  # a strike that rocked back never passed the balance
    return next((fit for fit in motion.alternatives if good and fit.estimator == "sign_change"), None)


def _by_axis(estimate: Estimate) -> dict[str, list[_Struck]]:
    """Strikes with verdict "good", by axis id, each with its plan and its fit by the paper's estimator.

    Strikes in which the object rocked back, slid, twisted or rolled are left out, and so are those without
    such a fit, and axes without a strike. The estimator takes the balance angle at the second sign change of
    the angular acceleration.
    """
    evidence = estimate.evidence
    found: dict[str, list[_Struck]] = {}
    for motion in evidence.motions:
        if (fit := sign_change_fit(motion)) is not None:
            planned = evidence.planned(motion)
            found.setdefault(planned.axis_id, []).append(_Struck(planned, motion, fit))
    return found


def _answer(strikes: Sequence[_Struck], estimate: Estimate) -> PaperAnswer:
    planes = [equiplane_from_fit(each.motion.strike_id, each.planned, each.fit) for each in strikes]
    com = paper_centre_of_mass(planes, estimate.cells).position
    weight = estimate.scale.mass * estimate.scale.gravity
    i_edge: dict[str, float] = {}
    left_out: dict[str, float] = {}
    for plane, each in zip(planes, strikes, strict=True):
        found = paper_axis_inertia(plane, each.motion, each.fit, com, weight)
        if found is not None:
            i_edge[plane.axis_id], left_out[plane.axis_id] = found.i_edge, found.excluded_share
    return PaperAnswer(com, i_edge, left_out, regions_at(planes, com, i_edge, estimate))


def regions_at(
    planes: Sequence[EquiPlane], com: Array, i_edge: dict[str, float], estimate: Estimate
) -> PaperRegions | None:
    """The paper's region masses (VISAPP 2013, eqs. 8, 9) for a given centre of mass and moments.

    Args:
        planes: equi-planes (through pivot line and centre of mass), one per axis; only the pivot lines count.
        com: (3,) centre of mass in the object frame O [m].
        i_edge: moment of inertia about the edge [kg m^2] by axis id.
        estimate: estimate of the session, for the body's mass and its cells (small pieces in shell or
            interior).

    Returns:
        The masses with their dividing plane; None if `i_edge` is empty, or for no axis three positive masses
        add up to the object's mass.
    """
    return paper_regions(planes, com, i_edge, estimate.scale.mass, estimate.cells) if i_edge else None


def refuse_without_tips(estimate: Estimate, name: str) -> None:
    """Refuse a session without a strike of verdict "good": the paper's method has no angle then.

    Args:
        estimate: estimate of the session.
        name: name of the session, for the message.

    Raises:
        EstimationError: no strike tipped over without sliding, twisting or rolling on.
    """
    if not _by_axis(estimate):
        raise EstimationError(
            f"{name}: no strike tipped over its edge without sliding, twisting or rolling, so the paper's "
            "method has no angle: record the session again"
        )
