"""The paper's plan as a StrikePlan, with its predicted precision and the faults that our checks find."""

from __future__ import annotations

import numpy as np

from analyze.errors import PlanError
from analyze.geometry.edge_radius import edge_radius
from analyze.planning import feasibility, impact
from analyze.planning.card import placement_card
from analyze.planning.design import MIN_NORMAL_SPREAD
from analyze.planning.information import COM, Candidate, Information, normal_spread, unknown_direction
from analyze.planning.next_edge import next_edge_rejection, with_next_edge
from analyze.planning.paper_plan import PaperStrike, paper_plan
from analyze.planning.pivots import PivotAxis, phi_spread, swing
from analyze.planning.plan import plan_hypothesis
from analyze.planning.precision import FRAME_PX, TrackedSwing, frame_sd, strike_covariances
from analyze.planning.prepared import PreparedObject
from analyze.planning.view import visible_markers
from analyze.types import Array
from schemas.strike_plan import Impact, Pivot, PlanMethod, PlannedStrike, Range, Rejection, StrikePlan

EDGE_SD = 5e-5
"""1 sigma of an edge's place [m], as for a shape that is taken as exact."""
TABLE_GAP = 1e-3
"""Smallest impact height that a StrikePlan can hold [m]."""


def paper_strike_plan(prepared: PreparedObject, object_sha256: str, strikes: int) -> StrikePlan:
    """Plan with the paper's first three impact points, the strikes distributed equally among them.

    The tip speed follows from the energy of eq. (2) (VISAPP 2013); the energy ratio E is that energy over the
    one needed for the expected centre of mass. Faults found by our checks (slip, lift, no tag in view, too
    fast or slow, too high or low for the striker, a set that leaves a direction of the centre of mass
    unknown) are listed as rejections or warnings in the plan, and the strikes are kept.

    Args:
        prepared: Object, bench and expected centre of mass.
        object_sha256: SHA-256 of object file and shape, to which the plan is bound.
        strikes: Number of strikes.

    Returns:
        The plan; its predicted covariance is None if the set leaves a direction unknown.

    Raises:
        PlanError: fewer than two stable planes that are not parallel, or fewer strikes than impact points.
    """
    model, spec = prepared.model, prepared.spec
    found = paper_plan(model, spec.mass_kg, prepared.bench.gravity)
    if strikes < len(found.struck):
        raise PlanError(
            f"{spec.name}: the paper strikes {len(found.struck)} points: ask for as many strikes or more"
        )
    each, left = divmod(strikes, len(found.struck))
    planned: list[PlannedStrike] = []
    candidates: list[Candidate] = []
    rejected: list[Rejection] = []
    for number, strike in enumerate(found.struck):
        axis = paper_axis(prepared, strike, f"{strike.plane.id}paper{number}")
        many = each + (number < left)
        candidate, entries, problems = _strikes(prepared, strike, axis, len(planned) + 1, many)
        candidates.append(candidate)
        planned += entries
        rejected += problems
    information = Information(tuple(candidates), prepared.information.belief, prepared.information.errors)
    normals = np.array([candidate.normal for candidate in candidates])
    warnings = [*model.warnings]
    if not found.as_printed:
        warnings.append(
            "eq. (1) as printed leaves fewer than two stable planes, as its sums grow with the number of "
            "points: means are used instead"
        )
    covariance: Array | None = None
    if normal_spread(normals) < MIN_NORMAL_SPREAD:
        along = ", ".join(f"{value:.2f}" for value in unknown_direction(normals))
        warnings.append(
            "the paper's first three by force are singular: they leave the centre of mass unknown along "
            f"({along})"
        )
    else:
        repeats = [sum(entry.axis_id == candidate.axis.id for entry in planned) for candidate in candidates]
        covariance = information.covariance(candidates, repeats)[COM, COM]
    return StrikePlan(
        method=PlanMethod.PAPER,
        object_name=spec.name,
        object_sha256=object_sha256,
        strikes=planned,
        predicted_com_covariance_m2=None if covariance is None else covariance.tolist(),
        predicted_com_sd_m=None if covariance is None else float(np.sqrt(np.trace(covariance))),
        hypothesis=plan_hypothesis(prepared),
        rejected=rejected,
        warnings=warnings,
    )


def paper_axis(prepared: PreparedObject, strike: PaperStrike, name: str) -> PivotAxis:
    """Pivot axis for one impact point of the paper's plan (VISAPP 2013), in the object frame.

    It runs along the centre line of the rounding of the edge that holds the rotation point (the point about
    which the object tips, at the rim of the resting face). The face that rises from the edge is taken as
    vertical; the axis's point lies beside the impact point.

    Args:
        prepared: Object, with its edge radius.
        strike: Impact point and rotation point.
        name: Id of the axis.
    """
    prior = edge_radius(prepared.spec, prepared.model, name, strike.rotation_point, strike.axis)
    point = strike.rotation_point + prior.mean * (strike.plane.up - strike.tip)
    point = point + strike.axis * float(strike.axis @ (strike.impact_point - point))
    return PivotAxis(
        name,
        strike.plane,
        strike.axis,
        strike.tip,
        point,
        prior.mean,
        EDGE_SD,
        rolls=False,
        radius_sd=prior.blurred_sd,
    )


def _strikes(
    prepared: PreparedObject, strike: PaperStrike, axis: PivotAxis, first: int, many: int
) -> tuple[Candidate, list[PlannedStrike], list[Rejection]]:
    """Axis with its expected tip, planned strikes, and faults, for one impact point by VISAPP 2013.

    The axis comes with the covariance of balance angle and ln k (k: rate constant of the tip) of one strike.
    Faults, such as a sliding edge, are only reported: the strikes are planned all the same.

    Args:
        prepared: Object, bench and expected centre of mass.
        strike: Impact point and rotation point.
        axis: Pivot axis of the strike.
        first: Number of the first strike in the plan, from 1.
        many: Number of equal strikes.
    """
    model, spec, bench, believed = prepared.model, prepared.spec, prepared.bench, prepared.believed
    expected = swing(axis, believed.region.centre, spec.mass_kg, believed.unit_inertia, bench.gravity)
    height = max(float((strike.impact_point - strike.rotation_point) @ axis.plane.up), TABLE_GAP)
    energy = strike.energy / (expected.distance * (1 - np.cos(expected.phi)))
    impulse = impact.impulse_for(expected, height, energy)
    speed = impact.tip_speed_for(bench.striker, expected, height, impulse)
    sight = visible_markers(model, spec, axis, expected.phi, bench.camera)
    case = feasibility.strike_case(
        axis, expected, believed.region.centre, believed.unit_inertia, height, impulse, bench.friction
    )
    outcome = feasibility.simulate_tips([case], bench.gravity)
    needed = float(feasibility.least_friction([case], bench.gravity)[0])
    load, slides = float(outcome.least_load[0]), float(outcome.slip[0])
    rejected: list[Rejection] = []

    def kept(code: str, number: float | None, text: str) -> None:
        rejected.append(Rejection(axis_id=axis.id, code=code, number=number, text=f"kept, though {text}"))

    if slides > feasibility.SLIP_LIMIT:
        kept(
            "slips",
            needed if np.isfinite(needed) else None,
            f"the edge would slide {min(1000 * slides, 999):.1f} mm",
        )
    if load <= 0:
        kept("lifts", load, "the edge would leave the table")
    if not sight.markers and any(marker.T_object_marker is not None for marker in spec.marker):
        kept(sight.fault.code, sight.fault.number, sight.fault.text)
    if problem := bench.striker.too_fast_or_slow(speed):
        kept("speed", speed, problem)
    if problem := bench.striker.too_high_or_low(height):
        kept("impact_unreachable", height, problem)
    followed = with_next_edge(model, axis, believed.region)
    if followed.next_edge is not None and followed.next_edge.firmness <= 1:
        each = next_edge_rejection(followed, believed)
        kept(each.code, each.number, each.text)
    pixels = sight.pixels if sight.markers else FRAME_PX
    (noise,) = strike_covariances(
        [TrackedSwing(expected, max(energy, 1.0), frame_sd(pixels))], bench.frame_rate
    )
    slower, faster = speed / np.sqrt(energy), speed * 1.2
    if not bench.striker.too_fast_or_slow(speed):
        slower, faster = np.clip([slower, faster], bench.striker.slowest_m_s, bench.striker.fastest_m_s)
    entry = PlannedStrike(
        id="",
        plane_id=axis.plane.id,
        axis_id=axis.id,
        R_world_object=axis.R_world_object.tolist(),
        p_world_object=axis.p_world_object.tolist(),
        pivot=Pivot(
            point=axis.point.tolist(), direction=axis.direction.tolist(), radius_m=axis.radius, sd_m=axis.sd
        ),
        impact=Impact(point=strike.impact_point.tolist(), direction=axis.tip.tolist()),
        impact_height_m=height,
        impulse_n_s=Range(min=float(impulse / np.sqrt(energy)), target=impulse, max=1.2 * impulse),
        tip_speed_m_s=Range(min=float(slower), target=speed, max=float(faster)),
        energy_ratio=float(energy),
        phi_predicted_rad=expected.phi,
        phi_predicted_sd_rad=phi_spread(axis, believed),
        i_edge_predicted_kg_m2=expected.i_edge,
        visible_markers=sight.markers,
        camera_pose=bench.camera.T_world_camera.tolist(),
        friction_needed=needed if np.isfinite(needed) else float(feasibility.FRICTIONS[-1]),
        card=placement_card(model, spec, axis, height, sight.markers),
    )
    entries = [entry.model_copy(update={"id": f"s{first + i}"}) for i in range(many)]
    return Candidate(axis, expected, noise), entries, rejected
