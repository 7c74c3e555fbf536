"""Headings that strikes over one edge share: what a hand repeats to a few degrees is one heading."""

from __future__ import annotations

import math
from collections.abc import Sequence

SAME_HEADING = math.radians(2.5)
"""largest difference of a strike's heading from the mean of its group [rad]; the motion's analysis finds the
object's own heading within it"""


def common_headings(headings: Sequence[float], axes: Sequence[str]) -> list[float]:
    """Heading of each strike, of strikes over one edge with nearly the same their mean [rad].

    The largest group of strikes within `SAME_HEADING` of its mean is taken first, then the largest of those
    left. Results are between -pi and pi; the mean of a group that is 0 to within a millionth is 0.

    Args:
        headings: heading of each strike [rad].
        axes: name of the edge of each strike.
    """
    found = list(headings)
    left = set(range(len(headings)))
    while left:
        axis = axes[min(left)]
        group = _largest(headings, [number for number in sorted(left) if axes[number] == axis])
        mean = _mean([headings[number] for number in group])
        for number in group:
            found[number] = 0.0 if abs(mean) < 1e-6 else mean
        left -= set(group)
    return found


def largest_group(headings: Sequence[float]) -> float:
    """Mean heading [rad] of the largest group of strikes with nearly the same; of several the first."""
    return _mean([headings[number] for number in _largest(headings, range(len(headings)))])


def _largest(headings: Sequence[float], numbers: Sequence[int]) -> list[int]:
    """Numbers of the largest group of strikes whose headings are within `SAME_HEADING` of their mean.

    Args:
        headings: heading of each strike [rad].
        numbers: numbers of the strikes that come into question.
    """
    best: list[int] = []
    for first in numbers:
        group = [first]
        # From the nearest to the farthest, as long as all are within the limit of their mean.
        for number in sorted(numbers, key=lambda each: _apart(headings[each], headings[first])):
            tried = [*group, number] if number != first else group
            mean = _mean([headings[each] for each in tried])
            if any(_apart(headings[each], mean) > SAME_HEADING for each in tried):
                break
            group = tried
        if len(group) > len(best):
            best = group
    return sorted(best)


def _mean(headings: Sequence[float]) -> float:
    """Mean direction of headings [rad], between -pi and pi [rad]."""
    return math.atan2(sum(map(math.sin, headings)), sum(map(math.cos, headings)))


def _apart(one: float, other: float) -> float:
    """Angle between two headings, from 0 to pi [rad]."""
    return abs(math.remainder(one - other, 2 * math.pi))
