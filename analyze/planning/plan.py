"""Plan of the strikes for an object: the most informative set of pivot edges, with precision."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from analyze.errors import PlanError
from analyze.geometry.station import turned_camera
from analyze.planning import design, forecast, impact
from analyze.planning.card import TURNED_CARD, placement_card
from analyze.planning.contents import contents_test, with_contents_test
from analyze.planning.examine import TURNED, UsableAxis
from analyze.planning.fillings import Pieces
from analyze.planning.footing import unsure_note
from analyze.planning.information import Information
from analyze.planning.next_edge import close_lines_note, doubtful_note, taken_over_note
from analyze.planning.pivots import PivotAxis
from analyze.planning.predicted_accuracy import predicted_accuracy
from analyze.planning.prepared import PreparedObject
from analyze.planning.refusal import refusal_message
from analyze.planning.scale_design import choose_scale_design
from analyze.planning.turned_strike import (
    TurnableAxis,
    best_turnable,
    turnable_axes,
    with_tilt_measured,
)
from schemas.strike_plan import (
    Impact,
    Pivot,
    PlanHypothesis,
    PlannedStrike,
    Range,
    StrikePlan,
    StrikerPrior,
)
from schemas.wording import counted

ENERGY_RANGE = (0.8, 1.6)
"""Energy ratios E for the smallest and the largest phi, which give the range of tip speeds."""


@dataclass(frozen=True)
class PlanRequest:
    """Request for a plan: number of strikes or error of the centre of mass, and options."""

    strikes: int = 9
    """Number of (further) strikes; with a target the largest number, if more than `forecast.MAX_STRIKES`."""
    target_com: float | None = None
    """Target rms distance of the estimated centre of mass from the true one [m], to reach with as few strikes
    as possible; None if none is set."""
    gravity: bool = False
    """True to add a strike of an edge with the object turned by 180 degrees, which measures the table's tilt;
    the usual strike of that edge is added too if it is not in the plan."""
    most_axes: int | None = None
    """Largest number of different axes, each a placement by hand; None for as many as pay."""
    contents: bool = False
    """True to strike one edge at three energies and on two faces, to test whether something moves inside."""
    tossed: bool = False
    """True if tosses follow, beside which one or two strikes are enough, for the size of the moments."""


def plan_strikes(
    prepared: PreparedObject, object_sha256: str, request: PlanRequest, cells: Pieces | None = None
) -> StrikePlan:
    """Choose the most informative set of strikes and assemble the plan.

    A target is the largest error of the centre of mass (rms distance [m]) that the user allows: then the
    fewest strikes that reach it are planned. A turned strike is one with object and striker turned by 180
    degrees on the table, which measures the table's tilt.

    Args:
        prepared: Checked axes (pivot edges about which the object tips) and what is known of the object.
        object_sha256: SHA-256 of object file and shape, to which the plan is bound.
        request: Number of strikes, target and options.
        cells: Pieces of the body; without them no region masses are predicted.

    Returns:
        The plan: strikes in the order in which to make them, the predicted precision, rejected axes and
        warnings. If no number of strikes reaches the target, it has the requested number, and its prediction
        says that the target is missed.

    Raises:
        PlanError: fewer than 3 strikes are requested, none was made before and no toss follows; no usable
            set of axes determines the centre of mass; or a turned strike is requested and no axis allows one.
            The message has the remedy.
    """
    spec, so_far = prepared.spec, prepared.information
    turnables: list[TurnableAxis] = []
    if request.gravity:
        turnables = turnable_axes(
            prepared.usable, prepared.model, spec, prepared.bench.camera, prepared.information.errors
        )
        prepared = replace(prepared, information=with_tilt_measured(prepared.information, turnables[0]))
    information = prepared.information
    few = request.strikes < design.MIN_STRIKES and not prepared.made
    if few and not request.tossed:
        raise PlanError(
            f"{spec.name}: {counted(request.strikes, 'strike')} cannot determine the centre of mass: ask for "
            f"{design.MIN_STRIKES} or more, or for tosses too (--tosses 3)"
        )
    chosen, missed = _for_scale(prepared, request) if few else _chosen(prepared, request, so_far)
    usable = [prepared.usable[i] for i in chosen.chosen]
    predicted = {each.axis_id: each for each in forecast.axis_forecasts(information, chosen)}
    order = sorted(
        zip(usable, chosen.repeats, strict=True),
        key=lambda pair: (pair[0].candidate.heading, *_placing_order(pair[0].candidate.axis, prepared)),
    )
    planned: list[PlannedStrike] = []
    for each, repeats in order:
        first = prepared.made + len(planned) + 1
        axis = predicted[each.candidate.axis.id]
        planned += [_strike(f"s{first + i}", each, prepared, axis) for i in range(repeats)]
    tested = None
    if request.contents:
        tested = contents_test(prepared, chosen.chosen, chosen.repeats)
        planned = with_contents_test(planned, tested, prepared, partial(_alone, prepared, chosen))
    if turnables:
        planned += _turned_strikes(turnables, prepared, chosen, len(planned))
    prediction = (
        None if few else predicted_accuracy(prepared, request.target_com, chosen, missed, so_far, cells)
    )
    return StrikePlan(
        object_name=spec.name,
        object_sha256=object_sha256,
        strikes=planned,
        predicted_com_covariance_m2=None if few else chosen.com_covariance.tolist(),
        predicted_com_sd_m=None if few else chosen.com_rms,
        prediction=prediction,
        hypothesis=plan_hypothesis(prepared),
        rejected=list(prepared.rejected),
        warnings=[
            *prepared.model.warnings,
            *_warnings(prepared, usable),
            *([tested.warning] if tested is not None and tested.warning else []),
        ],
    )


def plan_hypothesis(prepared: PreparedObject) -> PlanHypothesis:
    """Entry of the plan with centre of mass, mass, gravity and striker that its tip speeds assume."""
    region, striker = prepared.believed.region, prepared.bench.striker
    return PlanHypothesis(
        com_m=region.centre.tolist(),
        com_covariance_m2=region.covariance().tolist(),
        mass_kg=prepared.spec.mass_kg,
        g_m_s2=prepared.bench.gravity,
        striker=StrikerPrior(
            effective_mass_kg=striker.effective_mass_kg,
            effective_mass_sd_kg=striker.effective_mass_sd_kg,
            restitution=striker.restitution,
            restitution_sd=striker.restitution_sd,
        ),
    )


def _chosen(prepared: PreparedObject, request: PlanRequest, so_far: Information) -> tuple[design.Design, str]:
    """Design (axes and strikes on each) for a request, and a message if it misses the target.

    The target is the largest error of the centre of mass (rms distance [m]) that the user allows. The message
    is empty if the target is reached or none is set. A missed target gives the design with the requested
    number of strikes.

    Args:
        prepared: Checked axes and what is known of the object.
        request: Number of strikes, target and options.
        so_far: Information before the planned strikes, without that of a turned strike (object and striker
            turned by 180 degrees, to measure the table's tilt).

    Raises:
        PlanError: no usable set of axes determines the centre of mass.
    """
    information, model = prepared.information, prepared.model
    least = 1 if prepared.made else design.MIN_STRIKES
    most = max(forecast.MAX_STRIKES, request.strikes)
    if request.target_com is not None:
        found = forecast.strikes_for(information, request.target_com, least, most, request.most_axes)
        if found is not None:
            return found[1], ""
    plain = design.choose_design(information, request.strikes, request.most_axes)
    if plain is None:
        if request.most_axes is not None and design.can_determine_com(information):
            raise PlanError(
                f"{prepared.spec.name}: {counted(request.most_axes, 'axis')} cannot determine the centre of "
                f"mass: allow {design.MIN_STRIKES} or more (--axes)"
            )
        raise PlanError(refusal_message(prepared))
    if request.target_com is None or plain.com_rms <= request.target_com:
        return plain, ""
    best = design.choose_design(information, most, request.most_axes) or plain
    advice = forecast.advice(information, plain, prepared.made, model.primitive is not None, so_far)
    where = "" if request.most_axes is None else f" on at most {counted(request.most_axes, 'axis')}"
    text = (
        f"{1000 * request.target_com:g} mm is out of reach: {counted(most, 'strike')}{where} reach "
        f"{1000 * best.com_rms:.3g} mm; these {sum(plain.repeats)}: {advice.text}"
    )
    return plain, text


def _for_scale(prepared: PreparedObject, request: PlanRequest) -> tuple[design.Design, str]:
    """Design of one or two strikes that measure the size of a tossed object's moments; no message.

    Raises:
        PlanError: no axis can be used.
    """
    found = choose_scale_design(prepared.information, request.strikes)
    if found is None:
        raise PlanError(refusal_message(prepared))
    return found, ""


def _strike(
    name: str,
    each: UsableAxis,
    prepared: PreparedObject,
    predicted: forecast.AxisForecast,
    turned_for: str = "",
) -> PlannedStrike:
    """Entry of the plan for one strike on a usable axis.

    Args:
        name: Id of the strike.
        each: Usable axis (edge to tip about) with its impact point.
        prepared: Object, bench (striker, camera, table) and faces on which the object may fall over.
        predicted: Standard deviations expected of one strike on the axis.
        turned_for: Purpose for which object and striker are turned by 180 degrees; empty to leave them as the
            axis needs it.
    """
    heading = TURNED if turned_for else each.candidate.heading
    turned = TURNED_CARD.format(purpose=turned_for or "as the camera then sees a tag") if heading else ""
    axis = each.candidate.axis.placed or each.candidate.axis
    expected, striker = each.candidate.expected, prepared.bench.striker
    stands = axis.plane.id not in prepared.unsure
    # c may lie elsewhere in Q: from the smallest energy at the smallest phi to the largest at the largest.
    cases = [
        (max(expected.phi - each.phi_sd, expected.phi / 2), ENERGY_RANGE[0]),
        (expected.phi, each.energy),
        (expected.phi + each.phi_sd, ENERGY_RANGE[1]),
    ]
    impulses = [
        impact.impulse_for(replace(expected, phi=phi), each.impact.height, energy) for phi, energy in cases
    ]
    speeds = [impact.tip_speed_for(striker, expected, each.impact.height, impulse) for impulse in impulses]
    slowest, target, fastest = np.clip(speeds, striker.slowest_m_s, striker.fastest_m_s)
    return PlannedStrike(
        id=name,
        plane_id=axis.plane.id,
        axis_id=axis.id,
        R_world_object=axis.R_world_object.tolist(),
        p_world_object=axis.p_world_object.tolist(),
        heading_rad=heading,
        pivot=Pivot(
            point=axis.point.tolist(), direction=axis.direction.tolist(), radius_m=axis.radius, sd_m=axis.sd
        ),
        impact=Impact(point=each.impact.point.tolist(), direction=axis.tip.tolist()),
        impact_height_m=each.impact.height,
        impulse_n_s=Range(min=impulses[0], target=impulses[1], max=impulses[2]),
        tip_speed_m_s=Range(min=float(slowest), target=float(target), max=float(fastest)),
        energy_ratio=each.energy,
        phi_predicted_rad=expected.phi,
        phi_predicted_sd_rad=each.phi_sd,
        phi_measured_sd_rad=predicted.phi_sd,
        i_edge_predicted_kg_m2=expected.i_edge,
        i_edge_measured_sd_kg_m2=predicted.i_edge,
        visible_markers=each.markers,
        camera_pose=turned_camera(prepared.bench.camera, heading).T_world_camera.tolist(),
        friction_needed=each.friction,
        rolls=axis.rolls,
        stands_surely=stands,
        card=turned
        + placement_card(
            prepared.model,
            prepared.spec,
            axis,
            each.impact.height,
            each.markers,
            stands,
            turned=heading != 0.0,
        ),
    )


def _alone(
    prepared: PreparedObject, chosen: design.Design, index: int, energy: float | None
) -> PlannedStrike:
    """Entry of the plan, still without a number, for a strike on a usable axis; None for its usual energy."""
    each = prepared.usable[index]
    alone = design.Design((index,), (1,), chosen.covariance)
    (predicted,) = forecast.axis_forecasts(prepared.information, alone)
    return _strike("s0", replace(each, energy=energy or each.energy), prepared, predicted)


def _turned_strikes(
    turnables: Sequence[TurnableAxis], prepared: PreparedObject, chosen: design.Design, planned: int
) -> list[PlannedStrike]:
    """Plan a strike with object and striker turned by 180 degrees, which measures the table's tilt.

    It is compared with a strike on the same axis at the usual heading; if none is planned or was made before,
    one precedes it. The turned strike comes last, since the striker's stand is moved for it.

    Args:
        turnables: Axes that can be struck turned, best first.
        prepared: Checked axes and what is known of the object.
        chosen: Design of the other strikes.
        planned: Number of strikes planned so far, from which the new ones are numbered.

    Returns:
        The turned strike, or the usual strike and the turned one.
    """
    struck = {each.axis.id for each in prepared.information.belief.struck}
    done = {
        *chosen.chosen,
        *(i for i, each in enumerate(prepared.usable) if each.candidate.axis.id in struck),
    }
    best = best_turnable(turnables, done)
    (predicted,) = forecast.axis_forecasts(
        prepared.information, design.Design((best.index,), (1,), chosen.covariance)
    )
    first = prepared.made + planned + 1
    strikes: list[PlannedStrike] = []
    if best.index not in done:
        strikes.append(_strike(f"s{first}", prepared.usable[best.index], prepared, predicted))
    strikes.append(
        _strike(f"s{first + len(strikes)}", best.usable, prepared, predicted, "to measure the table's tilt")
    )
    return strikes


def _placing_order(axis: PivotAxis, prepared: PreparedObject) -> tuple[float, str, int, str]:
    """Sort key of a pivot axis, to order strikes: those with the object on the surest faces come first.

    On the surest faces the object stands wherever its centre of mass is expected; the strikes there show
    whether it stands on the other faces.

    Returns:
        Minus the face's firmness (largest factor, at most 1, by which the region of the centre of mass can be
        scaled and still lie over the face), id of the face, length of the axis's id, and this id.
    """
    firm = (
        min(axis.plane.firmness(prepared.believed.region), 1.0) if axis.plane.id in prepared.unsure else 1.0
    )
    return -round(firm, 6), axis.plane.id, len(axis.id), axis.id


def _warnings(prepared: PreparedObject, used: Sequence[UsableAxis]) -> list[str]:
    planes = [each.candidate.axis.plane for each in used]
    unsure = unsure_note(planes, prepared.unsure, prepared.believed.region)
    axes = [each.candidate.axis for each in used]
    warnings = [
        text for text in (unsure, doubtful_note(axes), close_lines_note(axes), taken_over_note(axes)) if text
    ]
    if any(each.candidate.axis.rolls for each in used):
        warnings.append(
            "round rims are used, on which the contact can roll: strike square to the rim; repeats show "
            "whether it rolled"
        )
    if any(each.candidate.heading for each in used):
        warnings.append(
            "the tags do not show enough edges from one end: the last strikes are made with object and "
            "striker turned by 180 degrees, as their cards show; tags on the opposite sides would spare that"
        )
    if any(each.impact.on_card for each in used):
        warnings.append(
            "some strikes meet a marker's card: a card of up to 1 mm has little effect; move it if it comes "
            "off"
        )
    if any(marker.T_object_marker is None for marker in prepared.spec.marker):
        warnings.append(
            "markers without T_object_marker are not planned with: give their poses (`analyze register` "
            "finds them in a recording of strikes), or check by eye that one faces the camera"
        )
    return warnings
