"""From an object to a plan: every axis is tried, those that cannot be used are named with the number that rules them out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.errors import PlanError
from analyze.geometry.object_model import ObjectModel
from analyze.planning import design, impact, view
from analyze.planning.card import placement_card
from analyze.planning.hypothesis import Hypothesis, hypothesis
from analyze.planning.impact import ImpactPoint, StrikerModel
from analyze.planning.pivots import PivotAxis, Swing, pivot_axes, swing
from analyze.planning.stable_planes import RestingPlane, resting_planes, stable_planes
from analyze.types import CameraModel
from schemas.documents import Impact, ObjectSpec, Pivot, PlannedStrike, Range, Rejection, StrikePlan

FRICTION = 0.4
"""between object and table, if nobody says otherwise"""
STEEPEST_PHI = np.radians(50.0)
ENERGY_TARGET = 1.15
ENERGY_RANGE = (0.8, 1.6)
STRIP = 0.02
"""part of the hull's area below which an unstable face is not worth its own line"""
ENERGIES = (1.15, 1.1, 1.2, 1.05, 1.25, 1.3)
"""tried in this order until the edge holds"""


@dataclass(frozen=True)
class _Usable:
    """An axis that passed every check."""

    candidate: design.Candidate
    impact: ImpactPoint
    energy: float
    friction: float
    phi_sd: float
    markers: list[int]


def make_plan(
    model: ObjectModel,
    spec: ObjectSpec,
    object_sha256: str,
    striker: StrikerModel,
    camera: CameraModel | None = None,
    strikes: int = 9,
    friction: float = FRICTION,
) -> StrikePlan:
    """Plan the strikes for one object.

    Args:
        model: its exterior.
        spec: mass, edge radius, markers.
        object_sha256: identity of specification and shape; the plan is bound to it.
        striker: what the striker can do.
        camera: as calibrated; None: the nominal one.
        strikes: how many.
        friction: least friction coefficient between object and table to count on.

    Raises:
        PlanError: fewer than 3 strikes are asked for, or no usable set of axes determines c; says what would help.
    """
    if strikes < 3:
        raise PlanError(f"{spec.name}: {strikes} strikes cannot determine a centre of mass: ask for 3 or more")
    camera = camera or view.default_camera()
    believed = hypothesis(model)
    planes = resting_planes(model)
    stable = stable_planes(planes, believed.region)
    rejected = _unstable(planes, stable, believed)
    usable: list[_Usable] = []
    for axis in pivot_axes(model, spec, stable, believed):
        outcome = _examine(model, spec, axis, believed, striker, camera, friction)
        if isinstance(outcome, Rejection):
            rejected.append(outcome)
        else:
            usable.append(outcome)
    errors = design.Errors(edge_radius=spec.edge_radius_sd_m)
    candidates = [each.candidate for each in usable]
    chosen = design.choose(candidates, strikes, errors)
    if chosen is None:
        raise PlanError(_why_not(spec, candidates, rejected))
    order = sorted(zip(chosen.chosen, chosen.repeats, strict=True), key=lambda pair: _placing_order(candidates[pair[0]].axis))
    planned: list[PlannedStrike] = []
    for index, repeats in order:
        first = len(planned) + 1
        planned += [_strike(f"s{first + i}", usable[index], model, spec, striker, camera) for i in range(repeats)]
    return StrikePlan(
        object_name=spec.name,
        object_sha256=object_sha256,
        strikes=planned,
        predicted_com_covariance_m2=chosen.covariance.tolist(),
        predicted_com_sd_m=float(np.sqrt(np.trace(chosen.covariance))),
        rejected=rejected,
        warnings=[*model.warnings, *_warnings(spec, [usable[index] for index, _ in order])],
    )


def _unstable(planes: Sequence[RestingPlane], stable: Sequence[RestingPlane], believed: Hypothesis) -> list[Rejection]:
    """One entry per face that the object may fall over on; the many strips of a round flank are one entry."""
    names = {plane.id for plane in stable}
    left = [plane for plane in planes if plane.id not in names]
    strips = [plane for plane in left if plane.area < STRIP * sum(each.area for each in planes)]
    text = "the object may fall over on this face: the centre of mass may lie outside its support"
    rejected = [
        Rejection(axis_id=plane.id, code="unstable_plane", number=plane.margin(believed.region.corners()), text=text)
        for plane in left
        if plane not in strips
    ]
    if strips:
        text = "narrow faces of a round or bevelled flank: the object rolls on them; number = how many"
        rejected.append(Rejection(axis_id=f"{strips[0].id}..{strips[-1].id}", code="flank", number=float(len(strips)), text=text))
    return rejected


def _examine(
    model: ObjectModel,
    spec: ObjectSpec,
    axis: PivotAxis,
    believed: Hypothesis,
    striker: StrikerModel,
    camera: CameraModel,
    friction: float,
) -> _Usable | Rejection:
    expected = swing(axis, believed.region.centre, spec.mass_kg, believed.unit_inertia, impact.GRAVITY)
    if expected.phi > STEEPEST_PHI:
        return _reject(
            axis, "too_steep", expected.phi, f"balances only after {np.degrees(expected.phi):.0f} deg: the edge would slip or lift"
        )
    placed = [marker for marker in spec.marker if marker.T_object_marker is not None]
    sight = view.visible_markers(model, spec, axis, expected.phi, camera)
    if placed and not sight.markers:
        text = f"no marker faces the camera through the tip (best is {np.degrees(sight.least_angle):.0f} deg off the axis)"
        return _reject(axis, "no_marker", sight.least_angle, text)
    cards = [(np.array(marker.T_object_marker)[:3, 3], marker.size_m) for marker in placed]
    rise = axis.plane.up * float(np.sqrt(axis.plane.up @ believed.region.covariance() @ axis.plane.up))
    swings = [expected] + [
        swing(axis, believed.region.centre + sign * rise, spec.mass_kg, believed.unit_inertia, impact.GRAVITY) for sign in (-1, 1)
    ]
    point = impact.best_impact(impact.impact_points(model, axis, swings, cards), friction)
    if point is None:
        return _reject(axis, "impact_unreachable", None, "no upright surface within the striker's reach at the impact's side")
    if point.friction > friction:
        return _reject(axis, "slips_at_impact", point.friction, f"the strike needs friction {point.friction:.2f} at the edge")
    energy, motion = _energy(expected, friction)
    if motion.least_load <= 0:
        return _reject(axis, "lifts", motion.least_load, "the edge would leave the table before balance")
    if motion.friction > friction:
        return _reject(axis, "slips", motion.friction, f"the swing needs friction {motion.friction:.2f} at the edge")
    speed = impact.tip_speed_for(striker, expected, point.height, impact.impulse_for(expected, point.height, energy))
    if not striker.slowest_m_s <= speed <= striker.fastest_m_s:
        return _reject(
            axis,
            "speed",
            speed,
            f"needs a tip speed of {speed:.2f} m/s: the striker gives {striker.slowest_m_s:g} to {striker.fastest_m_s:g}",
        )
    sd = _phi_sd(axis, believed, spec)
    return _Usable(design.Candidate(axis, expected), point, energy, max(point.friction, motion.friction), sd, sight.markers)


def _energy(expected: Swing, friction: float) -> tuple[float, impact.Motion]:
    """The target ratio, or the nearest at which the edge holds; if none does, the one that asks least."""
    tried = [(energy, impact.free_motion(expected, energy)) for energy in ENERGIES]
    for energy, motion in tried:
        if motion.least_load > 0 and motion.friction <= friction:
            return energy, motion
    return min(tried, key=lambda pair: (pair[1].least_load <= 0, pair[1].friction))


def _phi_sd(axis: PivotAxis, believed: Hypothesis, spec: ObjectSpec) -> float:
    """1 sigma [rad] of phi over Q."""
    arm = believed.region.centre - axis.point
    expected = swing(axis, believed.region.centre, spec.mass_kg, believed.unit_inertia, impact.GRAVITY)
    across = np.cross(axis.direction, arm - axis.direction * (arm @ axis.direction)) / expected.distance**2
    return float(np.sqrt(across @ believed.region.covariance() @ across))


def _strike(name: str, each: _Usable, model: ObjectModel, spec: ObjectSpec, striker: StrikerModel, camera: CameraModel) -> PlannedStrike:
    axis, expected = each.candidate.axis, each.candidate.expected
    # c may lie elsewhere in Q: from the least energy at the smallest phi to the most at the largest.
    cases = [
        (max(expected.phi - each.phi_sd, expected.phi / 2), ENERGY_RANGE[0]),
        (expected.phi, each.energy),
        (expected.phi + each.phi_sd, ENERGY_RANGE[1]),
    ]
    impulses = [impact.impulse_for(replace(expected, phi=phi), each.impact.height, energy) for phi, energy in cases]
    speeds = [impact.tip_speed_for(striker, expected, each.impact.height, impulse) for impulse in impulses]
    slowest, target, fastest = np.clip(speeds, striker.slowest_m_s, striker.fastest_m_s)
    return PlannedStrike(
        id=name,
        plane_id=axis.plane.id,
        axis_id=axis.id,
        R_world_object=axis.R_world_object.tolist(),
        p_world_object=axis.p_world_object.tolist(),
        pivot=Pivot(point=axis.point.tolist(), direction=axis.direction.tolist(), radius_m=axis.radius, sd_m=axis.sd),
        impact=Impact(point=each.impact.point.tolist(), direction=axis.tip.tolist()),
        impact_height_m=each.impact.height,
        impulse_n_s=Range(min=impulses[0], target=impulses[1], max=impulses[2]),
        tip_speed_m_s=Range(min=float(slowest), target=float(target), max=float(fastest)),
        energy_ratio=each.energy,
        phi_predicted_rad=expected.phi,
        phi_predicted_sd_rad=each.phi_sd,
        i_edge_predicted_kg_m2=expected.i_edge,
        visible_markers=each.markers,
        camera_pose=camera.T_world_camera.tolist(),
        friction_needed=each.friction,
        rolls=axis.rolls,
        card=placement_card(model, spec, axis, each.impact.height, each.markers),
    )


def _placing_order(axis: PivotAxis) -> tuple[str, int, str]:
    return axis.plane.id, len(axis.id), axis.id


def _reject(axis: PivotAxis, code: str, number: float | None, text: str) -> Rejection:
    return Rejection(axis_id=axis.id, code=code, number=number, text=text)


def _warnings(spec: ObjectSpec, used: Sequence[_Usable]) -> list[str]:
    warnings: list[str] = []
    if any(each.candidate.axis.rolls for each in used):
        warnings.append("round rims are used: the contact can roll; strike square to the rim, repeats show whether it did")
    if any(each.impact.on_card for each in used):
        warnings.append("some strikes meet a marker's card: a card of 1 mm or less is felt little, move it if it comes off")
    if any(marker.T_object_marker is None for marker in spec.marker):
        warnings.append(
            "markers without T_object_marker are not planned with: give their places, or check by eye that one faces the camera"
        )
    return warnings


def _why_not(spec: ObjectSpec, candidates: Sequence[design.Candidate], rejected: Sequence[Rejection]) -> str:
    state = "no axis can be used"
    if candidates:
        along = ", ".join(f"{value:.2f}" for value in design.unknown_direction(candidates))
        state = f"the {len(candidates)} usable axes leave the centre of mass unknown along ({along})"
    axes = [rejection for rejection in rejected if rejection.code not in ("unstable_plane", "flank")]
    counts = Counter(rejection.code for rejection in axes)
    remedies = {
        "no_marker": "glue markers to the faces square to the edges",
        "slips_at_impact": "use a mat with more friction",
        "slips": "use a mat with more friction",
        "speed": "change the striker's effective mass or its speed limits",
        "impact_unreachable": "glue on a plate that the striker can meet",
        "lifts": "glue the object to a base that is less wide for its height",
        "too_steep": "stand it on a smaller face, or glue on a base that allows it",
    }
    reasons = ", ".join(f"{number} {code}" for code, number in counts.most_common()) or "no stable resting plane with an edge to tip over"
    # In order of ease: what is cheapest to change among the things that stood in the way.
    remedy = next((text for code, text in remedies.items() if code in counts), "glue it to a flat base")
    return f"{spec.name}: {state}; rejected: {reasons}: {remedy}"
