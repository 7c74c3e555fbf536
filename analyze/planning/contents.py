"""Strikes that test whether something moves inside: three energies on one edge, and two poses (method 10)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from analyze.errors import PlanError
from analyze.planning import feasibility, impact
from analyze.planning.examine import UsableAxis
from analyze.planning.prepared import PreparedObject
from schemas.strike_plan import PlannedStrike

SLOW, MIDDLE = 1.06, 1.25
"""Energy ratios of the slow and the middle strike on the tested edge."""
FAST = (1.6, 1.5, 1.4)
"""Energy ratios of the fast one, tried in this order until the edge holds."""
STRIKES_PER_POSE = 2
"""Fewest strikes in each of two poses."""


@dataclass(frozen=True)
class ContentsTest:
    """Strikes that a test of contents requires: energies on one axis, further strikes on others."""

    index: int
    """Index of the tested axis among the usable ones."""
    energies: tuple[float, float, float]
    """Energy ratios of its first three strikes."""
    added: tuple[int, ...]
    """Indices of axes that are each struck once more, beyond the chosen ones and the three."""
    warning: str
    """What the plan cannot test; "" if it tests both."""


def contents_test(prepared: PreparedObject, chosen: Sequence[int], repeats: Sequence[int]) -> ContentsTest:
    """Strikes that a test of contents requires beyond a design's.

    The tested axis is one of the chosen ones if its edge holds at three energies, that with most strikes
    first; else any usable one. Of the other poses that with most strikes gets as many as are needed.

    Args:
        prepared: Checked axes and what is known of the object.
        chosen: Indices among the usable axes of those that the design strikes.
        repeats: Number of strikes of the design on each of them.

    Raises:
        PlanError: no edge holds at three energies.
    """
    usable = prepared.usable
    order = [index for _, index in sorted(zip([-many for many in repeats], chosen, strict=True))]
    order += [index for index in range(len(usable)) if index not in chosen]
    found = next(((i, fast) for i in order if (fast := _fastest(usable[i], prepared)) is not None), None)
    if found is None:
        raise PlanError(
            f"{prepared.spec.name}: no edge holds a strike of {FAST[-1]:g} times the energy for tipping that"
            " the striker can give, so that strikes cannot show whether something moves inside: put it on a"
            " rougher mat, or take a faster or heavier striker, and state it in the rig file; or plan without"
            " --contents"
        )
    tested, fast = found
    poses = Counter[str]()
    for index, many in zip(chosen, repeats, strict=True):
        poses[_pose(usable[index])] += many
    own = _pose(usable[tested])
    others = [index for index in order if _pose(usable[index]) != own]
    if not others:
        warning = (
            "all edges that can be struck belong to one face: contents that lie elsewhere when the object"
            " stands on another face are not tested"
        )
        return ContentsTest(tested, (SLOW, MIDDLE, fast), (), warning)
    best = max(others, key=lambda index: poses[_pose(usable[index])])
    missing = STRIKES_PER_POSE - poses[_pose(usable[best])]
    return ContentsTest(tested, (SLOW, MIDDLE, fast), (best,) * max(missing, 0), "")


def with_contents_test(
    planned: Sequence[PlannedStrike],
    tested: ContentsTest,
    prepared: PreparedObject,
    strike_on: Callable[[int, float | None], PlannedStrike],
) -> list[PlannedStrike]:
    """Planned strikes with those that a test of contents requires, numbered anew.

    The first strikes on the tested axis take its energies. What is missing of them, and of a second pose, is
    put behind the strikes on the same axis, or at the end.

    Args:
        planned: Strikes of the design, in the order in which to make them.
        tested: Strikes that the test requires.
        prepared: Checked axes and what is known of the object.
        strike_on: Function that gives the entry of the plan for a strike on the usable axis of an index, at
            an energy ratio; None for the axis' usual one.
    """
    left, found = list(tested.energies), list[PlannedStrike]()
    axis_id = prepared.usable[tested.index].candidate.axis.id
    for strike in planned:
        on_axis = strike.axis_id == axis_id and strike.heading_rad == 0.0
        found.append(strike_on(tested.index, left.pop(0)) if on_axis and left else strike)
    further = [strike_on(tested.index, energy) for energy in left]
    for strike in [*further, *(strike_on(index, None) for index in tested.added)]:
        same = [i for i, each in enumerate(found) if each.axis_id == strike.axis_id]
        found.insert(same[-1] + 1 if same else len(found), strike)
    first = prepared.made + 1
    return [each.model_copy(update={"id": f"s{first + i}"}) for i, each in enumerate(found)]


def _pose(each: UsableAxis) -> str:
    """Id of the face that the object rests on for an axis."""
    return each.candidate.axis.plane.id


def _fastest(each: UsableAxis, prepared: PreparedObject) -> float | None:
    """Greatest of the fast energies at which the edge holds and the striker is fast enough; None for none."""
    expected, striker, believed = each.candidate.expected, prepared.bench.striker, prepared.believed
    impulses = [impact.impulse_for(expected, each.impact.height, energy) for energy in FAST]
    cases = [
        feasibility.strike_case(
            each.candidate.axis,
            expected,
            believed.region.centre,
            believed.unit_inertia,
            each.impact.height,
            impulse,
            prepared.bench.friction,
        )
        for impulse in impulses
    ]
    outcome = feasibility.simulate_tips(cases, prepared.bench.gravity)
    holds = (outcome.slip <= feasibility.SLIP_LIMIT) & (outcome.least_load > 0)
    for energy, impulse, hold in zip(FAST, impulses, np.asarray(holds).tolist(), strict=True):
        speed = impact.tip_speed_for(striker, expected, each.impact.height, impulse)
        if hold and not striker.too_fast_or_slow(speed):
            return energy
    return None
