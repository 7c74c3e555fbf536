"""Checks of every pivot axis: a marker in view, an impact point in reach, an edge that holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.geometry.object_model import ObjectModel
from analyze.geometry.station import turned_camera
from analyze.planning import feasibility, impact, view
from analyze.planning.hypothesis import Hypothesis
from analyze.planning.impact import ImpactPoint, StrikerModel
from analyze.planning.information import Candidate
from analyze.planning.pivots import PivotAxis, Swing, phi_spread, swing
from analyze.planning.precision import FRAME_PX, FRAME_RATE, TrackedSwing, frame_sd, strike_covariances
from analyze.types import CameraModel
from schemas.object_spec import ObjectSpec
from schemas.rig_limits import TABLE_FAR_EDGE_M
from schemas.strike_plan import Rejection

STEEP_PHI, MAX_PHI = np.radians(50.0), np.radians(65.0)
"""Balance angle phi [rad] beyond which most edges slide, so that one that fails any check is too steep, and
largest phi of a usable axis. Wide, light bodies hold: a funnel tips over its rim at 59 deg."""
TURNED = float(np.pi)
"""Heading [rad] of a strike with object and striker turned, at which the camera sees the edge's other end."""
ENERGIES = (1.15, 1.1, 1.2, 1.05, 1.25, 1.3)
"""Energy ratios E (energy over that needed to reach balance), tried in this order until the edge holds."""


@dataclass(frozen=True)
class Bench:
    """Striker, camera and table that a plan is made for."""

    striker: StrikerModel
    """Striker, with the speeds and heights that it can reach."""
    camera: CameraModel
    """Camera, with its pose in a strike's world frame."""
    friction: float
    """Smallest friction coefficient between object and table."""
    gravity: float = impact.GRAVITY
    """Gravity [m/s^2]."""
    frame_rate: float = FRAME_RATE
    """Frame rate of the camera [Hz]."""
    has_plate: bool = False
    """True if an upright plate that the striker can meet is assumed on the object."""
    table_far_edge: float = TABLE_FAR_EDGE_M
    """Distance of the table's far edge behind the pivot line [m]."""


@dataclass(frozen=True)
class UsableAxis:
    """Axis that passed every check: a marker in view, an impact point in reach, an edge that holds.

    phi is the balance angle, Q the region believed to hold the centre of mass.
    """

    candidate: Candidate
    """The axis with its expected swing and the noise of one strike."""
    impact: ImpactPoint
    """Place to strike."""
    energy: float
    """Energy ratio E of the strike: energy over that needed to reach balance."""
    friction: float
    """Smallest friction coefficient with which the edge holds, at most that of the bench."""
    phi_sd: float
    """1 sigma of phi over Q [rad]."""
    markers: list[int | str]
    """Names of the markers that the camera sees through the tip; empty if no marker's pose is known."""


@dataclass(frozen=True)
class _Reached:
    """Axis that passed the first checks: balance angle, a marker in view, an impact point in reach.

    The marker counts only if marker poses are known. Whether the edge holds and the tip speed is in reach is
    still to be checked.
    """

    axis: PivotAxis
    """Pivot axis."""
    expected: Swing
    """Swing for the expected centre of mass."""
    point: ImpactPoint
    """Place to strike."""
    sight: view.MarkerVisibility
    """Markers that the camera sees through the tip."""


def examine(
    model: ObjectModel,
    spec: ObjectSpec,
    axes: Sequence[PivotAxis],
    believed: Hypothesis,
    bench: Bench,
    heading: float = 0.0,
) -> tuple[list[UsableAxis], list[Rejection]]:
    """Check axes for a marker in view, an impact point and tip speed in reach, and an edge that holds.

    An edge holds if it neither slides nor lifts off. The balance angle must be at most `MAX_PHI` too.

    Args:
        model: Shape of the object.
        spec: Mass, edge radius and markers.
        axes: Pivot axes to check.
        believed: Region believed to hold the centre of mass, and the inertia per kilogram.
        bench: Striker, camera and table.
        heading: Turn [rad] of object and striker about the vertical; the camera stays.

    Returns:
        Usable axes in the order given, and one rejection for each of the others.
    """
    bench = replace(bench, camera=turned_camera(bench.camera, heading))
    outcomes = [_reach(model, spec, axis, believed, bench) for axis in axes]
    rejected = [each for each in outcomes if isinstance(each, Rejection)]
    reached = [each for each in outcomes if isinstance(each, _Reached)]
    held = _friction_checks(reached, believed, bench)
    passed: list[tuple[_Reached, TrackedSwing, float]] = []
    for each, outcome in zip(reached, held, strict=True):
        if isinstance(outcome, Rejection):
            rejected.append(_steep(outcome, each.expected))
            continue
        energy, friction = outcome
        speed = impact.tip_speed_for(bench.striker, each.expected, each.point.height, _impulse(each, energy))
        if problem := bench.striker.too_fast_or_slow(speed):
            rejected.append(_steep(_reject(each.axis, "speed", speed, problem), each.expected))
            continue
        pixels = each.sight.pixels if each.sight.markers else FRAME_PX
        passed.append((each, TrackedSwing(each.expected, energy, frame_sd(pixels)), friction))
    covariances = strike_covariances([seen for _, seen, _ in passed], bench.frame_rate)
    usable = [
        UsableAxis(
            Candidate(each.axis, each.expected, noise, heading),
            each.point,
            seen.energy,
            friction,
            phi_spread(each.axis, believed),
            each.sight.markers,
        )
        for (each, seen, friction), noise in zip(passed, covariances, strict=True)
    ]
    return usable, rejected


def _reach(
    model: ObjectModel, spec: ObjectSpec, axis: PivotAxis, believed: Hypothesis, bench: Bench
) -> _Reached | Rejection:
    """Expected swing, impact point and visible markers of an axis; a rejection if it lacks one of them.

    The swing is that of the expected centre of mass: balance angle [rad], rate and lever arm. An axis that
    balances beyond the angle `MAX_PHI` is rejected too (as too steep, like any that fails beyond
    `STEEP_PHI`), and one whose rounding has its centre above that of mass: the object rolls back from any
    angle.

    Args:
        model: Shape of the object.
        spec: Mass and markers; without marker poses none need be visible.
        axis: Pivot axis to check.
        believed: Region of the centre of mass and inertia per kilogram.
        bench: Striker, camera and table.
    """
    expected = swing(axis, believed.region.centre, spec.mass_kg, believed.unit_inertia, bench.gravity)
    below = float((axis.point - believed.region.centre) @ axis.plane.up)
    if below >= 0:
        return _reject(
            axis,
            "no_balance",
            below,
            f"has no balance angle: the centre of its rounding, of {1000 * axis.radius:.0f} mm radius, is "
            f"{1000 * below:.1f} mm above the expected centre of mass, so that the object rolls back",
        )
    if expected.phi > MAX_PHI:
        return _reject(
            axis,
            "too_steep",
            expected.phi,
            f"balances only after {np.degrees(expected.phi):.0f} deg: beyond {np.degrees(MAX_PHI):.0f} deg "
            "the edge would slip or lift",
        )
    placed = [marker for marker in spec.marker if marker.T_object_marker is not None]
    sight = view.visible_markers(model, spec, axis, expected.phi, bench.camera)
    if placed and not sight.markers:
        return _steep(_reject(axis, sight.fault.code, sight.fault.number, sight.fault.text), expected)
    cards = [(np.array(marker.T_object_marker)[:3, 3], marker.size_m) for marker in placed]
    rise = axis.plane.up * float(np.sqrt(axis.plane.up @ believed.region.covariance() @ axis.plane.up))
    swings = [expected] + [
        swing(axis, believed.region.centre + sign * rise, spec.mass_kg, believed.unit_inertia, bench.gravity)
        for sign in (-1, 1)
    ]
    points = impact.impact_points(model, axis, swings, cards, bench.striker)
    if bench.has_plate and not points:
        points = impact.plate_points(model, axis, swings, bench.striker)
    point = impact.best_impact(points, bench.friction)
    if point is None:
        text = (
            "beside the edge's middle there is no upright surface that the striker can meet without touching "
            f"another part of the object ({1000 * bench.striker.lowest_m:.0f} to "
            f"{1000 * bench.striker.highest_m:.0f} mm over the table)"
        )
        return _steep(_reject(axis, "impact_unreachable", None, text), expected)
    return _Reached(axis, expected, point, sight)


def _friction_checks(
    reached: Sequence[_Reached], believed: Hypothesis, bench: Bench
) -> list[tuple[float, float] | Rejection]:
    """Simulate the strike on each axis: energy ratio and friction if the edge holds, or a rejection.

    The first of `ENERGIES` at which the edge neither slips nor lifts is taken.

    Args:
        reached: Axes with an impact point.
        believed: Region of the centre of mass and inertia per kilogram.
        bench: Striker, camera and table.

    Returns:
        For each axis, in order, either the energy ratio (energy over that needed to reach balance) and the
        smallest sufficient friction coefficient, or its rejection.
    """
    many = len(ENERGIES)
    cases = [_case(each, energy, believed, bench) for each in reached for energy in ENERGIES]
    outcome = feasibility.simulate_tips(cases, bench.gravity)
    slip, load = outcome.slip.reshape(-1, many), outcome.least_load.reshape(-1, many)
    holds = (slip <= feasibility.SLIP_LIMIT) & (load > 0)
    best = [int(np.argmax(row)) if row.any() else int(np.argmin(slip[i])) for i, row in enumerate(holds)]
    needed = feasibility.least_friction(
        [_case(each, ENERGIES[k], believed, bench) for each, k in zip(reached, best, strict=True)],
        bench.gravity,
    )
    result: list[tuple[float, float] | Rejection] = []
    for i, (each, k) in enumerate(zip(reached, best, strict=True)):
        if holds[i, k]:
            result.append((ENERGIES[k], float(min(needed[i], bench.friction))))
        elif slip[i, k] > feasibility.SLIP_LIMIT:
            slides = f"the edge would slide {min(1000 * float(slip[i, k]), 999):.1f} mm"
            number, why = None, " at any friction"
            if np.isfinite(needed[i]):
                number = float(needed[i])
                why = f": it needs friction {number:.2f}, there is {bench.friction:.2f}"
            result.append(_reject(each.axis, "slips", number, slides + why))
        else:
            result.append(
                _reject(
                    each.axis, "lifts", float(load[i, k]), "the edge would leave the table before balance"
                )
            )
    return result


def _case(each: _Reached, energy: float, believed: Hypothesis, bench: Bench) -> feasibility.StrikeCase:
    return feasibility.strike_case(
        each.axis,
        each.expected,
        believed.region.centre,
        believed.unit_inertia,
        each.point.height,
        _impulse(each, energy),
        bench.friction,
    )


def _impulse(each: _Reached, energy: float) -> float:
    return impact.impulse_for(each.expected, each.point.height, energy)


def _reject(axis: PivotAxis, code: str, number: float | None, text: str) -> Rejection:
    return Rejection(axis_id=axis.id, code=code, number=number, text=text)


def _steep(rejection: Rejection, expected: Swing) -> Rejection:
    """Rejection for too large a balance angle, if that is beyond `STEEP_PHI`; else the rejection as given."""
    if expected.phi <= STEEP_PHI:
        return rejection
    text = f"balances only after {np.degrees(expected.phi):.0f} deg, and {rejection.text}"
    return rejection.model_copy(update={"code": "too_steep", "number": float(expected.phi), "text": text})
