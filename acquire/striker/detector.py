"""Detection of the contact during a swing, and the count of contacts after it."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from acquire.striker.sample import VELOCITY_UNIT_RAD_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from acquire.striker.sample import Sample

OVERTRAVEL_M = 0.002
"""distance [m] beyond angle 0 at which the swing ends at the latest, whether or not a contact was detected"""
EARLY_CONTACT_M = 0.02
"""distance [m] before angle 0 from which a drop of speed counts, so that the early contact with an object
placed this much too near is still detected"""
DROP_FRACTION = 0.08
"""fraction of the speed whose loss counts as a drop while the arm swings"""
DROP_READS = 3
"""consecutive reads with a drop that end the swing"""
MAX_TURN_NS = 30_000_000
"""longest time from contact to the command to turn back within which a second contact is excluded [ns]"""


class ContactDetector:
    """Detector of the moment at which a swinging arm must turn back, fed sample by sample.

    Args:
        arm_length: length of the arm [m].
        velocity: commanded arm velocity [rad/s].
    """

    def __init__(self, arm_length: float, velocity: float) -> None:
        self._beyond = OVERTRAVEL_M / arm_length
        self._near = -EARLY_CONTACT_M / arm_length
        self._velocity = velocity
        self._before: deque[float] = deque(maxlen=12)
        self._low = 0

    def must_turn_back(self, sample: Sample) -> bool:
        """True if the arm must turn back now; call once with every sample of the swing, in order.

        There are two reasons. Either the tip is more than 2 mm beyond the impact point (angle 0). Or there is
        a contact: from 20 mm before the impact point on, three consecutive samples are slow, that is, slower
        by 8 % (at least 0.06 rad/s) than the mean velocity of the last 12 samples that were not slow. That
        mean must exceed 0.7 of the commanded velocity.
        """
        if sample.position_rad > self._beyond:
            return True
        steady = sum(self._before) / len(self._before) if len(self._before) == self._before.maxlen else 0.0
        threshold = max(DROP_FRACTION * steady, 2.5 * VELOCITY_UNIT_RAD_S)
        at_speed = sample.position_rad > self._near and steady > 0.7 * self._velocity
        if at_speed and sample.velocity_rad_s < steady - threshold:
            self._low += 1
        else:
            self._low = 0
            self._before.append(sample.velocity_rad_s)
        return self._low >= DROP_READS


def count_contacts(samples: Sequence[Sample], contact_ns: int, turned_ns: int, arm_length: float) -> int:
    """Number of contacts between arm and object that may have occurred in a strike, at least one.

    The count is one, plus every new approach of the arm to the object after the arm moved back. A second
    contact while the arm brakes would not show in the samples. So one more is counted, unless the arm was
    commanded to turn back within 30 ms of the first contact, while the struck object is still faster than the
    arm. If the samples never show the arm moving back, the number is two.

    Args:
        samples: samples of swing and retraction, in order.
        contact_ns: host monotonic time of the first contact [ns].
        turned_ns: host monotonic time at which the retraction was commanded [ns].
        arm_length: length of the arm [m].
    """
    contacts = 1 if turned_ns - contact_ns <= MAX_TURN_NS else 2
    away = False
    for sample in samples:
        if sample.time_ns <= turned_ns:
            continue
        if not away:
            away = sample.velocity_rad_s < 0 and sample.position_rad < OVERTRAVEL_M / arm_length
        elif (
            sample.velocity_rad_s > 5 * VELOCITY_UNIT_RAD_S
            and sample.position_rad > -2 * OVERTRAVEL_M / arm_length
        ):
            contacts += 1
            away = False
    return contacts if away or contacts > 1 else contacts + 1
