"""Each strike as all others foretell it: its phi and k (estimation/checks.py), and from its first free frames on its theta(t)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from analyze.estimation.checks import SIGMAS
from analyze.estimation.joint import OF_TWO
from analyze.motion.predicted_motion import Foretold, ForetoldMotion, foretold_motion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.checks import LeftOut
    from analyze.pipeline.evidence import Evidence


@dataclass(frozen=True)
class ForetoldStrike:
    """A strike beside what the others make of it."""

    told: LeftOut
    motion: ForetoldMotion

    @property
    def motion_sigmas(self) -> float:
        """Of theta(t), as one standardised error: what its frames make of phi and k, against what the others do."""
        return OF_TWO * math.sqrt(self.motion.squared)

    @property
    def holds(self) -> bool:
        """It is what the others say."""
        return self.told.foretold and self.motion_sigmas <= SIGMAS


def foretold_strikes(evidence: Evidence, left_out: Sequence[LeftOut]) -> tuple[ForetoldStrike, ...]:
    """Foretell theta(t) of each strike that was used; `left_out` as checks.leave_one_out gives it."""
    motions = {motion.strike_id: motion for motion in evidence.motions}
    found: list[ForetoldStrike] = []
    for told in left_out:
        motion = motions[told.strike_id]
        if motion.angle is None or motion.fit is None:
            continue
        there = evidence.recording_of(told.strike_id).manifest.g_m_s2 / evidence.manifest.g_m_s2
        expected = Foretold(told.phi, told.k * there, told.by_others, told.own)
        found.append(ForetoldStrike(told, foretold_motion(told.strike_id, motion.angle, motion.fit, expected)))
    return tuple(found)
