"""Note on strikes at which a tall object reaches up to the hub of the printed arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analyze.types import Array
from schemas.strike_plan import PlannedStrike

HUB_CLEARANCE_M = 0.025
"""Height below the hinge that the object must leave free [m]: the hub's radius and 5 mm."""
LENGTH_STEP_M = 0.01
"""Step to which a longer arm is rounded up [m]."""


def note_on_hub(strikes: Sequence[PlannedStrike], vertices: Array, arm_length_m: float) -> str | None:
    """Sentence that names the strikes at which the hub would touch the object; None if there are none.

    The hub is ahead of the pad, above the object, where an arm's length above the impact point is the hinge.

    Args:
        strikes: Strikes of the plan.
        vertices: (n, 3) vertices of the object, in its frame [m].
        arm_length_m: Length of the arm [m].
    """
    needed: dict[str, float] = {}
    for strike in strikes:
        if strike.impact_height_m is None:
            continue
        up = np.array(strike.R_world_object)[2]
        top = float((vertices @ up).max()) + strike.p_world_object[2]
        length = top - strike.impact_height_m + HUB_CLEARANCE_M
        if length > arm_length_m:
            needed[strike.id] = length
    if not needed:
        return None
    longest = np.ceil(max(needed.values()) / LENGTH_STEP_M - 1e-9) * LENGTH_STEP_M
    return (
        f"{', '.join(needed)}: the object reaches higher than {1000 * HUB_CLEARANCE_M:.0f} mm below the "
        f"hinge of an arm of {1000 * arm_length_m:.0f} mm, whose printed hub would touch it: arm_length_m = "
        f"{longest:.2f} clears it, or a striker without a hub"
    )
