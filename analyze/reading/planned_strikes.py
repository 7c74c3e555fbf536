"""How much of its plan a recording holds: a session that was interrupted leaves a whole file with too few strikes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from schemas.strike_plan import StrikePlan

MOST_NAMED = 12
"""missing strikes that a line names"""


@dataclass(frozen=True)
class PlannedStrikes:
    """Ids of the strikes that were planned, and of those that nobody made, in the plan's order."""

    planned: tuple[str, ...]
    missing: tuple[str, ...]

    def text(self) -> str:
        """One line, for people."""
        named = ", ".join(self.missing[:MOST_NAMED])
        more = f" and {len(self.missing) - MOST_NAMED} more" if len(self.missing) > MOST_NAMED else ""
        missing = f"; missing: {named}{more}" if self.missing else ""
        return f"{len(self.planned) - len(self.missing)} of {len(self.planned)} planned strikes were struck{missing}"


def planned_strikes(plan: StrikePlan, struck: Iterable[str]) -> PlannedStrikes:
    """What of `plan` is done.

    Args:
        plan: the recording's.
        struck: plan strikes of its records; any attempt counts, however it was judged.
    """
    made = set(struck)
    planned = tuple(strike.id for strike in plan.strikes)
    return PlannedStrikes(planned, tuple(name for name in planned if name not in made))
