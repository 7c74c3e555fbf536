"""How hard to strike next: learns from each strike how much energy the tip gets for its speed.

For one axis the energy ratio goes with the square of the tip speed, E = a·v² (METHOD.md 1.5); `a` is predicted by the plan from a
hypothesis about the object and the striker. The object's part of the error belongs to the axis, the striker's part to all axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from schemas.documents import PlannedStrike

ROCKED_BACK_STEP = 1.35
"""factor on the energy after a strike that rocked back without a usable reading"""


@dataclass
class SpeedController:
    """Energy per squared speed, relative to the plan's, as learned for each axis and over all."""

    energy_goal: float = 1.15
    _log_gain: dict[str, float] = field(default_factory=dict)

    def tip_speed(self, strike: PlannedStrike) -> float:
        """Speed to command for the next strike at this axis [m/s], within the plan's limits."""
        gain = math.exp(self._log_gain.get(strike.axis_id, self._common()))
        speed = strike.tip_speed_m_s.target * math.sqrt(self.energy_goal / (strike.energy_ratio * gain))
        return min(max(speed, strike.tip_speed_m_s.min), strike.tip_speed_m_s.max)

    def learn(self, strike: PlannedStrike, tip_speed_m_s: float, energy_ratio: float | None) -> None:
        """Take in what a strike at `tip_speed_m_s` gave; None: it rocked back and nothing could be read."""
        expected = strike.energy_ratio * (tip_speed_m_s / strike.tip_speed_m_s.target) ** 2
        if energy_ratio is None:
            old = self._log_gain.get(strike.axis_id, self._common())
            self._log_gain[strike.axis_id] = old - math.log(ROCKED_BACK_STEP)
        elif energy_ratio > 0:
            self._log_gain[strike.axis_id] = math.log(energy_ratio / expected)

    def _common(self) -> float:
        """Mean over the axes tried so far: what they share is the striker."""
        return sum(self._log_gain.values()) / len(self._log_gain) if self._log_gain else 0.0
