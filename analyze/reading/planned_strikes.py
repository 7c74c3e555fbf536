"""Compares the strikes that a recording contains with those of its plan.

If a session is interrupted, its recording is a complete file with too few strikes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from schemas.strike_plan import StrikePlan
from schemas.wording import counted

MAX_NAMED_STRIKES = 12
"""largest number of missing strikes whose ids `PlannedStrikes.text` lists"""


@dataclass(frozen=True)
class PlannedStrikes:
    """Ids of all strikes of a plan, and of those that were not struck, both in the plan's order."""

    planned: tuple[str, ...]
    """ids of all strikes of the plan"""
    missing: tuple[str, ...]
    """ids of the strikes of the plan that were not struck"""

    def text(self, *, so_far: bool = False) -> str:
        """One line for the user, such as "2 of 3 planned strikes were struck; missing: s2".

        At most `MAX_NAMED_STRIKES` ids are listed, then "and n more"; none with `so_far`, for a session that
        still runs.
        """
        named = ", ".join(self.missing[:MAX_NAMED_STRIKES])
        unnamed = len(self.missing) - MAX_NAMED_STRIKES
        more = f" and {unnamed} more" if unnamed > 0 else ""
        missing = f"; missing: {named}{more}" if self.missing else ""
        made = len(self.planned) - len(self.missing)
        if so_far:
            return f"{made} of {counted(len(self.planned), 'planned strike')} struck so far"
        return f"{made} of {counted(len(self.planned), 'planned strike', 'was')} struck{missing}"


def planned_strikes(plan: StrikePlan, struck: Iterable[str]) -> PlannedStrikes:
    """Ids of the planned strikes of a recording, and of those that were not struck.

    Args:
        plan: the recording's plan.
        struck: planned ids of the strikes that were made; any attempt counts, whatever its verdict.
    """
    made = set(struck)
    planned = tuple(strike.id for strike in plan.strikes)
    return PlannedStrikes(planned, tuple(name for name in planned if name not in made))
