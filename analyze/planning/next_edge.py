"""Check that an object tips over its planned pivot edge up to balance, not over one that lands before.

The edge (or line of a rounding) over which the object turns at an instant carries it; the next takes over
when it touches the table.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.motion.rolling_choice import is_curved, next_landing
from analyze.motion.support_function import support_of_outline
from analyze.motion.supports import LIFTED_RAD, support_lines
from analyze.planning.examine import MAX_PHI
from analyze.planning.pivots import NextEdge, phi_spread
from schemas.strike_plan import Rejection

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.geometry.object_model import ObjectModel
    from analyze.motion.support_function import SupportFunction
    from analyze.planning.hypothesis import Hypothesis, Region
    from analyze.planning.pivots import PivotAxis
    from analyze.types import SupportLine

CODE = "next_edge"
"""Rejection code of axes whose neighbour may land before balance."""
MAX_SHIFT_M = 5e-4
"""Largest shift [m] of the support line at which an axis is still used, with a larger sd of its place; for an
axis whose own sd is larger, that sd is the limit."""
MARGIN_RAD = math.radians(1.0)
"""Angle [rad] before the take-over by which balance must come, for unequal rounding and for a few frames
past balance."""
MEASURABLE_SHIFT_M = 2.5e-3
"""Distance [m] of two lines from which the motion shows which of them carries: 4 sd of the markers' place."""
SMALL_CURVE_M = 1e-3
"""Largest distance [m] of the lines of a curve that count as close: those of a curve too small to roll on,
whose radius is below 0.5 mm."""
CARRYING_SHARE = 0.35
"""Scale of Q, the region believed to hold the centre of mass, for which the planned edge, or the line that
takes over from it, must carry at balance. For all of Q, a bottle or carton with cut corners would lose edges
that its balance angle needs; a strike that balances over another line is recognised and costs only itself."""


def with_next_edge(model: ObjectModel, axis: PivotAxis, region: Region) -> PivotAxis:
    """Copy of a pivot axis with the edge that lands next as the object tips, over which it then turns.

    Edges at most `MAX_SHIFT_M` (or the sd of the axis's place, if larger) away count as the same edge; that
    sd is enlarged by their distance. Returned as they are: an axis on a curved flank or with a moulded
    rounding, on which the object rolls; one whose balance angle is too large for a strike (`MAX_PHI`); and
    any axis if the shape has no area across it.

    Args:
        model: Shape of the object.
        axis: Pivot axis.
        region: Region believed to hold the centre of mass, in the object frame.
    """
    across = np.stack([axis.tip, axis.plane.up])
    points = (model.hull_vertices - axis.point) @ across.T
    phi = _expected_phi(axis, region)
    if phi > MAX_PHI:
        return axis
    try:
        section = support_of_outline(points, np.zeros(2), axis.radius)
        if axis.moulded or is_curved(section, phi):
            return _rolling_until(axis, region, section, next_landing(section, phi))
        supports = support_lines(points, axis.radius, axis.sd, join_curves=False)
    except EstimationError:
        return axis
    off = _edge_offset(model, axis)
    most = max(MAX_SHIFT_M, axis.sd)
    if off > most:
        return replace(axis, next_edge=NextEdge(0.0, off, -1.0))
    shifts = [_apart(line, supports[0]) for line in supports]
    away = next((i for i, shift in enumerate(shifts) if shift > most), len(shifts))
    found = [math.inf, *(_firmness(axis, region, supports, i) for i in range(1, len(supports)))]
    # A line that takes over only beyond balance shifts nothing.
    shift = max([off, *(each for i, each in enumerate(shifts[:away]) if found[i] <= 1.0)])
    axis = replace(axis, sd=math.hypot(axis.sd, shift))
    if away == len(shifts):
        return axis
    next_edge = NextEdge(supports[away].takes_over_rad, shifts[away], found[away])
    shares = [(_carrying_share(axis, region, supports, i), i) for i in range(away, len(supports))]
    share, i = max(shares)
    if share > CARRYING_SHARE:
        next_edge = replace(next_edge, carrier=supports[i], carrier_firmness=share)
    return replace(axis, next_edge=next_edge)


def _rolling_until(axis: PivotAxis, region: Region, section: SupportFunction, lands: float) -> PivotAxis:
    """Copy of a pivot axis on which the object rolls, with the face that lands next, such as a handle.

    Args:
        axis: Pivot axis on a curved flank or with a moulded rounding.
        region: Region believed to hold the centre of mass, in the object frame.
        section: Support function of the hull across the axis, about the axis's point.
        lands: Tipping angle [rad] at which that face lands; infinite if none does.
    """
    if not math.isfinite(lands):
        return axis
    shift = section.longest_flat(lands - section.step, lands + 2 * section.step)
    at = max(lands - axis.sd / max(shift, axis.sd) - MARGIN_RAD, 0.0)
    _, ahead, _ = section.evaluate(np.array(at))
    room = _room(axis, region, at, float(ahead))
    return replace(axis, next_edge=NextEdge(lands, shift, room))


def over_next_line(axis: PivotAxis) -> PivotAxis | None:
    """Pivot axis on the line over which the object turns at balance after its first edge; None if none.

    The line has landed (taken over) before balance. The object is still placed with the first edge on the
    mark: that edge is the result's `placed`.

    Args:
        axis: Pivot axis, with the edge that takes over from it.
    """
    following = axis.next_edge
    if following is None or following.carrier is None:
        return None
    line = following.carrier
    left = NextEdge(line.takes_over_rad, following.shift, following.carrier_firmness)
    point = axis.point + line.along_m * axis.tip + line.up_m * axis.plane.up
    return replace(axis, point=point, radius=line.radius_m, next_edge=left, placed=axis)


def over_close_lines(model: ObjectModel, axis: PivotAxis, region: Region) -> PivotAxis | None:
    """Pivot axis amid close lines over which the object turns in succession; None if they are not close.

    A small rounding is a few facets in a mesh, and a bevel one: lines at most `MEASURABLE_SHIFT_M` apart. The
    axis lies in the middle of those that carry at balance for some centre of mass in the region. Half the
    distance from the first line to the last of them is added to the standard deviation of its place, so that
    the analysis of a strike takes all of them for one. A line farther away must not carry for any centre of
    mass in the region scaled by `CARRYING_SHARE`. On a moulded rounding the object rolls: None.

    Args:
        model: Shape of the object.
        axis: Pivot axis with a next edge.
        region: Region believed to hold the centre of mass, in the object frame.
    """
    across = np.stack([axis.tip, axis.plane.up])
    points = (model.hull_vertices - axis.point) @ across.T
    supports = support_lines(points, axis.radius, axis.sd, join_curves=False)
    firm = [math.inf, *(_firmness(axis, region, supports, i) for i in range(1, len(supports))), math.inf]
    off = _edge_offset(model, axis)
    near = [
        _apart(line, supports[0]) + off <= (SMALL_CURVE_M if line.is_curve else MEASURABLE_SHIFT_M)
        for line in supports
    ]
    last = near.index(False) - 1 if False in near else len(near) - 1
    if axis.moulded or last < 0 or firm[last + 1] <= CARRYING_SHARE:
        return None
    last = next(i for i in range(last + 1) if firm[i + 1] > 1 or i == last)
    first = max(i for i in range(last + 1) if i == 0 or firm[i] < -1)
    low, high = supports[first].along_m - (0.0 if first else off), supports[last].along_m
    spread = _apart(supports[last], supports[0]) + off
    after = (
        NextEdge(supports[last + 1].takes_over_rad, _apart(supports[last + 1], supports[0]), firm[last + 1])
        if last + 1 < len(supports)
        else None
    )
    point = axis.point + axis.tip * (low + high) / 2
    sd = math.hypot(axis.sd, spread / 2)
    return replace(axis, point=point, sd=sd, next_edge=after, lines_apart=spread)


def _edge_offset(model: ObjectModel, axis: PivotAxis) -> float:
    """Distance [m] along the table from the planned edge to the corner that touches just after rest.

    It is above 0 only if a facet beside the resting face is nearly parallel to that face: after a small turn
    the object then touches the table at the facet's far corner.

    Args:
        model: Shape of the object.
        axis: Pivot axis.
    """
    first = axis.tip * math.sin(LIFTED_RAD) - axis.plane.up * math.cos(LIFTED_RAD)
    lowest = model.hull_vertices[int(np.argmax(model.hull_vertices @ first))]
    return abs(float((lowest - axis.edge[0]) @ axis.tip))


def _apart(line: SupportLine, other: SupportLine) -> float:
    """Distance [m] of two support lines (parallel lines over which the object turns in succession)."""
    return math.hypot(line.along_m - other.along_m, line.up_m - other.up_m)


def _firmness(axis: PivotAxis, region: Region, supports: Sequence[SupportLine], i: int) -> float:
    """Largest scale of a region of centres of mass for which the line before line i carries at balance.

    A line carries while the object turns over it. It does so at balance if the centre of mass has passed
    above it when line i lands, with a margin of `MARGIN_RAD` and of the error of that angle. It must be so
    for every centre of mass in the region, scaled about its centre. Negative if it is not so for the centre
    itself.

    Args:
        axis: Pivot axis.
        region: Region believed to hold the centre of mass, in the object frame.
        supports: Lines over which the object turns in succession.
        i: Index of a line, 1 or more.
    """
    # Of a curve's short facets all together have the error of one long one.
    off = min(supports[i].takes_over_sd_rad, axis.sd / max(_apart(supports[i], supports[0]), 1e-9))
    at = max(supports[i].takes_over_rad - off - MARGIN_RAD, 0.0)
    return _room(axis, region, at, supports[i - 1].ahead_m(at))


def _room(axis: PivotAxis, region: Region, theta: float, ahead: float) -> float:
    """Largest scale of a region for which every centre of mass in it has passed above the contact.

    Args:
        axis: Pivot axis.
        region: Region believed to hold the centre of mass, in the object frame, scaled about its centre.
        theta: Tipping angle [rad].
        ahead: Horizontal distance [m] of the contact from the axis's point at that angle.

    Returns:
        The scale; negative if not even the region's centre has passed.
    """
    forward = axis.tip * math.cos(theta) + axis.plane.up * math.sin(theta)
    room = float((region.centre - axis.point) @ forward) - ahead
    return room / max(float(region.reach(forward[None])[0]), 1e-12)


def _carrying_share(axis: PivotAxis, region: Region, supports: Sequence[SupportLine], i: int) -> float:
    """Largest scale of a region of centres of mass for which support line i carries at balance.

    A line carries while the object turns over it, until the next one lands. The centre of mass must not yet
    have passed above any earlier line when the next one lands, and must have passed above line i when line i
    + 1 lands. Negative if it is not so for the region's centre; -1 for an axis or line that rolls, and for a
    line nearer than `MEASURABLE_SHIFT_M` to the planned edge.

    Args:
        axis: Pivot axis.
        region: Region believed to hold the centre of mass, in the object frame.
        supports: Lines over which the object turns in succession.
        i: Index of a line, 1 or more.
    """
    line = supports[i]
    if axis.rolls or line.is_curve or _apart(line, supports[0]) < MEASURABLE_SHIFT_M:
        return -1.0
    scales = [] if i + 1 == len(supports) else [_firmness(axis, region, supports, i + 1)]
    for before, after in pairwise(supports[: i + 1]):
        at = after.takes_over_rad + after.takes_over_sd_rad + 2 * MARGIN_RAD
        forward = axis.tip * math.cos(at) + axis.plane.up * math.sin(at)
        room = before.ahead_m(at) - float((region.centre - axis.point) @ forward)
        scales.append(room / max(float(region.reach(forward[None])[0]), 1e-12))
    return min(scales)


def next_edge_rejection(axis: PivotAxis, believed: Hypothesis) -> Rejection:
    """Rejection of a pivot axis whose next edge may land before balance, with the reason in words.

    Its `number` is the tipping angle [rad] at which that edge lands.

    Args:
        axis: Pivot axis with a next edge.
        believed: Hypothesis with the region that is believed to hold the centre of mass.
    """
    takes_over, shift = (
        (0.0, 0.0) if axis.next_edge is None else (axis.next_edge.takes_over, axis.next_edge.shift)
    )
    phi, sd = _expected_phi(axis, believed.region), phi_spread(axis, believed)
    low, high = math.degrees(max(phi - 2 * sd, 0.0)), math.degrees(phi + 2 * sd)
    text = (
        f"another edge, {1000 * shift:.1f} mm from this one, touches the table at "
        f"{math.degrees(takes_over):.0f} deg, and balance comes at {low:.0f} to {high:.0f} deg: the object "
        "may tip over that edge instead"
    )
    return Rejection(axis_id=axis.id, code=CODE, number=takes_over, text=text)


def doubtful_note(used: Sequence[PivotAxis]) -> str:
    """Warning with remedy that a plan uses axes whose next edge may land before balance; empty if none.

    Args:
        used: Pivot axes of the plan's strikes.
    """
    listed = ", ".join(
        f"{axis.id} (next edge {1000 * axis.next_edge.shift:.1f} mm away, at "
        f"{math.degrees(axis.next_edge.takes_over):.0f} deg)"
        for axis in used
        if axis.next_edge is not None and axis.next_edge.firmness <= 1 and axis.placed is None
    )
    if not listed:
        return ""
    return (
        "the plan uses edges that carry the object up to balance if its centre of mass is near its expected "
        f"place, but whose neighbour may touch the table before: {listed}. A strike that balances over the "
        "neighbour counts for that one if the motion shows it; else it gets the verdict wrong_edge and is "
        "left out: plan again with --given RECORDING, from which the centre of mass is known better"
    )


def close_lines_note(used: Sequence[PivotAxis]) -> str:
    """Note that a plan uses rounded or bevelled edges whose line is known less well; empty if none."""
    listed = ", ".join(f"{axis.id} (± {1000 * axis.sd:.1f} mm)" for axis in used if axis.lines_apart)
    if not listed:
        return ""
    return (
        f"small bevels or coarse roundings of the shape leave open which line carries the object: {listed}. "
        "A finer mesh of the roundings, or sharper edges, would determine the centre of mass better"
    )


def taken_over_note(used: Sequence[PivotAxis]) -> str:
    """Note that strikes of a plan balance over a line that lands after their first edge; empty if none.

    Args:
        used: Pivot axes of the plan's strikes.
    """
    listed = ", ".join(
        f"{axis.id} (next line {1000 * float(np.linalg.norm(axis.point - axis.placed.point)):.1f} mm out)"
        for axis in used
        if axis.placed is not None
    )
    if not listed:
        return ""
    return (
        "the edges that carry the object up to balance do not suffice: the plan also uses edges from which "
        f"the next line takes over before balance: {listed}. Such a strike counts for that line if "
        "the motion shows it, for which the tags' places on the object must be known"
    )


def _expected_phi(axis: PivotAxis, region: Region) -> float:
    """Balance angle [rad] about an axis with the centre of mass at the centre of the region believed in."""
    arm = region.centre - axis.point
    return math.atan2(-float(arm @ axis.tip), float(arm @ axis.plane.up))
