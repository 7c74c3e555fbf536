"""The rule that ends a swing in time, and how many contacts a swing can have had."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from acquire.striker.servo import VELOCITY_UNIT_RAD_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from acquire.striker.servo import Sample

OVERTRAVEL_M = 0.002
"""the swing ends here at the latest, seen contact or not"""
NEAR_M = 0.02
"""before angle 0, from where a drop counts: an object put down this much too near is struck too early, and known to be"""
DROP_FRACTION = 0.08
"""of the speed; what counts as a drop while the arm swings"""
DROP_READS = 3
"""in a row"""
TURN_NS = 30_000_000


class ContactDetector:
    """Says, read by read, when to turn back. Sees at most what the servo has told so far.

    Args:
        arm_length: m.
        velocity: rad/s, commanded.
    """

    def __init__(self, arm_length: float, velocity: float) -> None:
        self._beyond = OVERTRAVEL_M / arm_length
        self._near = -NEAR_M / arm_length
        self._velocity = velocity
        self._before: deque[float] = deque(maxlen=12)
        self._low = 0

    def turn_back(self, sample: Sample) -> bool:
        """Whether the contact is over, or must be by now."""
        if sample.position_rad > self._beyond:
            return True
        steady = sum(self._before) / len(self._before) if len(self._before) == self._before.maxlen else 0.0
        threshold = max(DROP_FRACTION * steady, 2.5 * VELOCITY_UNIT_RAD_S)
        if sample.position_rad > self._near and steady > 0.7 * self._velocity and sample.velocity_rad_s < steady - threshold:
            self._low += 1
        else:
            self._low = 0
            self._before.append(sample.velocity_rad_s)
        return self._low >= DROP_READS


def count_contacts(samples: Sequence[Sample], contact_ns: int, turned_ns: int, arm_length: float) -> int:
    """Contacts that the arm can have had: one, plus every approach after the arm turned back.

    The servo cannot feel a second touch while it brakes. What it can tell is whether it was told to turn in time: within 30 ms, in which a
    struck object, that left faster than the arm followed, has not yet slowed to the arm's speed; and whether the arm ever came back.

    Args:
        samples: of swing and retraction, in order.
        contact_ns: host monotonic.
        turned_ns: when the retraction was commanded.
        arm_length: m.
    """
    contacts = 1 if turned_ns - contact_ns <= TURN_NS else 2
    away = False
    for sample in samples:
        if sample.time_ns <= turned_ns:
            continue
        if not away:
            away = sample.velocity_rad_s < 0 and sample.position_rad < OVERTRAVEL_M / arm_length
        elif sample.velocity_rad_s > 5 * VELOCITY_UNIT_RAD_S and sample.position_rad > -2 * OVERTRAVEL_M / arm_length:
            contacts += 1
            away = False
    return contacts if away or contacts > 1 else contacts + 1
