"""Prints a strike plan on the terminal: strikes, expected accuracy, and axes left out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np
from rich.table import Table

from analyze.cards.by_hand import force_words
from analyze.planning.rejections import rejection_summary
from analyze.result.digits import decimals, inertia_unit, number
from analyze.types import TENSOR_ENTRIES, tensor_entry_name
from schemas.strike_plan import PlanMethod, PlannedStrike, PlannedToss, Prediction, StrikePlan
from schemas.terminal import Terminal
from schemas.wording import counted

NOT_DETERMINED = "not determined"


def render_plan(plan: StrikePlan, console: Terminal | None = None, by_hand: bool = False) -> None:
    """Print a strike plan: table of strikes, expected accuracy, advice, warnings, and axes left out.

    Args:
        plan: the plan.
        console: where to print; None for standard output.
        by_hand: True for strikes by hand: how hard, in a word, in place of the tip speed.
    """
    console = console or Terminal()
    if plan.strikes:
        console.print(_strike_table(plan, by_hand))
    if plan.prediction is not None:
        console.print(_prediction_table(plan, plan.prediction))
        console.print(f"advice: {plan.prediction.advice}")
    elif plan.predicted_com_sd_m is not None:
        console.print(
            f"predicted: centre of mass to {1000 * plan.predicted_com_sd_m:.2f} mm (root mean square "
            "distance)",
        )
    if plan.tosses:
        name = "" if plan.strikes else f"{plan.object_name}: "
        console.print(f"{name}{_tosses(plan.tosses)}")
    for warning in plan.warnings:
        console.print(f"note: {warning}")
    if plan.rejected and plan.method is PlanMethod.PAPER:
        for problem in plan.rejected:
            console.print(f"{problem.axis_id}: {problem.code}: {problem.text}")
    elif plan.rejected:
        console.print(
            f"left out: {rejection_summary(plan.rejected)}; the plan file gives the reasons, with numbers",
        )


def _strike_table(plan: StrikePlan, by_hand: bool) -> Table:
    how = ", by the paper's method" if plan.method is PlanMethod.PAPER else ""
    table = Table(
        title=f"{plan.object_name}: {counted(len(plan.strikes), 'strike')}{how}",
        title_justify="left",
        padding=(0, 0),
        pad_edge=False,
    )
    table.add_column("strikes", no_wrap=True)
    table.add_column("axis", no_wrap=True)
    force = "how hard" if by_hand else "speed"
    for heading in ("tips at", "strike at", force, "E", "µ needed", "tag", "φ ±", "I_edge ±"):
        table.add_column(heading, justify="right", no_wrap=True)
    for _, group in groupby(plan.strikes, key=_row_of):
        same = list(group)
        first = same[0]
        names = first.id if len(same) == 1 else f"{first.id}–{same[-1].id}"
        table.add_row(
            names,
            first.axis_id + (f" at {np.degrees(first.heading_rad):.0f}°" if first.heading_rad else ""),
            f"{np.degrees(first.phi_predicted_rad):.0f}±{np.degrees(first.phi_predicted_sd_rad):.0f}°",
            f"{1000 * first.aim.impact_height_m:.0f} mm",
            force_words(first)[0] if by_hand else f"{first.aim.tip_speed_m_s.target:.2f} m/s",
            f"{first.aim.energy_ratio:.2f}",
            f"{first.aim.friction_needed:.2f}",
            ", ".join(map(str, first.visible_markers)) or "–",
            "–" if first.phi_measured_sd_rad is None else f"±{np.degrees(first.phi_measured_sd_rad):.2f}°",
            _relative(first),
        )
    return table


def _row_of(strike: PlannedStrike) -> tuple[str, float, float | None]:
    """Axis, heading and energy ratio, which the strikes of one row of the table share."""
    return strike.axis_id, strike.heading_rad, strike.energy_ratio


def _tosses(tosses: Sequence[PlannedToss]) -> str:
    """Line on the tosses: ids, spin, time in the air, place, and distance of the axes from principal ones."""
    first, apex_y = tosses[0], tosses[0].p_world_apex[1]
    names = first.id if len(tosses) == 1 else f"{first.id}–{tosses[-1].id}"
    angles = [toss.principal_axis_angle_rad for toss in tosses if toss.principal_axis_angle_rad is not None]
    apart = f"; spin axes {np.degrees(min(angles)):.0f}° or more from a principal axis" if angles else ""
    tag = "" if first.smallest_tag_px is None else f"; smallest tag {first.smallest_tag_px:.0f} px"
    return (
        f"{counted(len(tosses), 'toss')} by hand, {names}: {first.turns_per_s.target:g} turns a second, "
        f"{first.flight_s.target:.2f} s in the air, {1000 * apex_y:.0f} mm behind the line{apart}{tag}"
    )


def _relative(strike: PlannedStrike) -> str:
    """Text of the sd of I_edge, the moment about the edge, in percent of it; "–" if it is not predicted."""
    if strike.i_edge_measured_sd_kg_m2 is None:
        return "–"
    return f"±{100 * strike.i_edge_measured_sd_kg_m2 / strike.i_edge_predicted_kg_m2:.1f} %"


def _prediction_table(plan: StrikePlan, prediction: Prediction) -> Table:
    table = Table(
        title="expected accuracy, 1 sd (95 % intervals reach ± 2 sd)", title_justify="left", show_header=False
    )
    table.add_column()
    table.add_column()
    each = ", ".join(f"±{1000 * sd:.2f}" for sd in prediction.com_sd_m)
    table.add_row("centre of mass x, y, z", f"{each} mm; rms distance {1000 * prediction.com_rms_m:.2f} mm")
    for name, value in _moment_rows(plan, prediction):
        table.add_row(name, value)
    for region in prediction.regions:
        table.add_row(
            f"mass, {region.name}",
            f"±{1000 * region.mass_sd_kg:.1f} g" if region.determined else NOT_DETERMINED,
        )
    curve = ", ".join(f"{step.strikes}: {1000 * step.com_rms_m:.2f}" for step in prediction.curve)
    table.add_row(
        "centre of mass by number of strikes [mm]",
        f"{curve}; any number on the axes of this plan: {1000 * prediction.floor_m:.2f}",
    )
    return table


def _moment_rows(plan: StrikePlan, prediction: Prediction) -> Iterator[tuple[str, str]]:
    """Yield names and sd of the moments of inertia that strikes determine, in a unit common to all.

    The moments are the tensor's entries, and those about struck axes that are not parallel to the object's
    axes, each through the centre of mass. Entries that no strike determines are named together.
    """
    tensor, sd = np.array(prediction.inertia_determined), np.array(prediction.inertia_sd_kg_m2)
    # A uniform box has a quarter of its moment about an edge about the parallel through its middle.
    unit = inertia_unit([strike.i_edge_predicted_kg_m2 / 4 for strike in plan.strikes])

    def shown(value: float) -> str:
        """Text of an sd [kg m²] in the common unit, with two significant digits."""
        return f"±{number(unit.factor * value, decimals(unit.factor * value))}"

    known = [f"{tensor_entry_name(each)} {shown(sd[each])}" for each in TENSOR_ENTRIES if tensor[each]]
    unknown = [tensor_entry_name(each) for each in TENSOR_ENTRIES if not tensor[each]]
    parts = [", ".join(known)] if known else []
    parts += [f"{NOT_DETERMINED}: {', '.join(unknown)}"] if unknown else []
    yield f"inertia tensor about it [{unit.label}]", "; ".join(parts)
    directions = {strike.axis_id: strike.pivot.direction for strike in plan.strikes}
    skew: dict[str, str] = {}
    for moment in prediction.moments:
        direction = directions[moment.axis_id]
        if np.count_nonzero(np.round(direction, 2)) > 1:
            value = shown(moment.i_com_sd_kg_m2) if moment.determined else NOT_DETERMINED
            skew.setdefault(f"moment about ({axis_text(direction)}) [{unit.label}]", value)
    yield from skew.items()


def axis_text(direction: Sequence[float]) -> str:
    """Text "x, y, z" of an axis's unit vector (3,), with two decimals.

    The vector is negated if its first rounded component that is not 0 is negative: an axis has no sign.
    """
    rounded = np.round(direction, 2) + 0.0
    leading = rounded[np.flatnonzero(rounded)[0]] if rounded.any() else 1.0
    return ", ".join(f"{value:.2f}" for value in rounded * np.sign(leading) + 0.0)
